"""Order ids as integers sort as the text does, and parts of ids are found by them."""

from hypothesis import given, settings
from hypothesis import strategies as st

from ledger.ids import OrderId
from ledger.state import Order
from projections.order_keys import contains, id_of, key_of, was_made
from projections.query import folded
from tests.projections.past import archive_of
from tests.strategies import SCENE

DAYS = st.sampled_from(["20231130", "20231201", "20240229"])
NUMBERS = st.text("0019", min_size=6, max_size=6) | st.integers(10**6, 10**9 - 1).map(str) | (
    st.sampled_from(["100000", "1000000", "10000000", "1000001", "120000", "1200001"])
)  # fmt: skip
IDS = st.builds("TO{}-{}{}".format, DAYS, NUMBERS, st.sampled_from(["", "A", "C", "P"]))
ODD = st.sampled_from(["", "TO1", "TO20240230-000001", "TO20240229-0000001", "TO20240229-000001X"])


@given(st.lists(IDS, min_size=2))
def test_keys_sort_as_ids_do_and_give_them_back(ids: list[str]) -> None:
    keys = [key.key for id_ in sorted(set(ids)) if (key := key_of(id_)) is not None]
    assert keys == sorted(set(keys))
    assert [id_of(key) for key in keys] == sorted(set(ids))
    assert all(0 <= key < 2**63 for key in keys)


@given(ODD)
def test_what_is_not_of_the_pattern_has_no_key(id_: str) -> None:
    assert key_of(id_) is None
    assert not was_made({"20240229": 10, "20240230": 10}, id_)


def order(id_: str) -> Order:
    return Order(
        id=OrderId(id_), scene=SCENE, created_ms=0, created_by="", modified_ms=0, modified_by=""
    )


SMALL = st.builds(
    "TO{}-{}{}".format,
    DAYS,
    st.text("0142", min_size=6, max_size=6),
    st.sampled_from(["", "A", "C", "P"]),
)


@settings(max_examples=10, deadline=None)
@given(st.lists(SMALL, min_size=1, max_size=12, unique=True), st.data())
def test_a_part_is_found_where_the_text_has_it(ids: list[str], data: st.DataObject) -> None:
    archive = archive_of([order(id_) for id_ in ids])
    cursor = archive.cursor()
    for _ in range(8):
        text = folded(data.draw(st.sampled_from(ids)))
        begin = data.draw(st.integers(0, len(text)))
        end = data.draw(st.integers(begin, len(text)))
        part = data.draw(st.just(text[begin:end]) | st.text("to-2014p", max_size=4))
        sql, parameters = contains(cursor, part)
        found = cursor.execute(f"SELECT id FROM orders_done WHERE {sql}", parameters).fetchall()
        assert sorted(id_ for (id_,) in found) == sorted(i for i in ids if part in folded(i)), part
    archive.close()
