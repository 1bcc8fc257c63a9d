"""Our own counting of calls says what Prometheus's client library would say."""

from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest

from fleetledger.call_figures import SECONDS, CallFigures

CALLS = st.tuples(
    st.sampled_from(("GET", "POST")),
    st.sampled_from(("/a", "/b")),
    st.sampled_from((200, 400)),
    st.sampled_from((*SECONDS, 0.0, 0.002, 3.0, 7.0)),
)


def _lines(registry: CollectorRegistry) -> set[str]:
    lines = generate_latest(registry).decode().splitlines()
    return {line for line in lines if "_created" not in line}


@given(st.lists(CALLS, max_size=30))
def test_calls_are_counted_as_the_client_library_counts(
    calls: list[tuple[str, str, int, float]],
) -> None:
    ours, theirs = CollectorRegistry(), CollectorRegistry()
    figures = CallFigures()
    ours.register(figures)
    counter = Counter(
        "fleetledger_http_calls", "HTTP calls", ["method", "route", "status"], registry=theirs
    )
    histogram = Histogram(
        "fleetledger_http_seconds", "Time to answer", ["route"], buckets=SECONDS, registry=theirs
    )
    for method, route, status, took_s in calls:
        figures.count(method, route, status, took_s)
        counter.labels(method, route, str(status)).inc()
        histogram.labels(route).observe(took_s)
    assert _lines(ours) == _lines(theirs)
