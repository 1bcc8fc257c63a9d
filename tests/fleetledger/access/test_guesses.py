from fleetledger.access.guesses import (
    ADDRESS_FREE,
    ADDRESS_WAIT_S_MAX,
    FORGOTTEN_AFTER_S,
    KNOWN_MAX,
    USER_FREE,
    USER_WAIT_S_MAX,
    Attempts,
    Guesses,
)


def test_waits_double_up_to_a_limit_and_are_forgotten() -> None:
    guesses = Guesses(free=2, wait_s_max=10.0)
    waits = []
    for _ in range(8):
        guesses.failed("anna", 100.0)
        waits.append(guesses.wait_s("anna", 100.0))

    assert waits == [0.0, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0, 10.0]
    assert guesses.wait_s("anna", 104.0) == 6.0
    assert guesses.wait_s("anna", 110.0) == 0.0
    guesses.failed("anna", 101.0 + FORGOTTEN_AFTER_S)
    assert guesses.wait_s("anna", 101.0 + FORGOTTEN_AFTER_S) == 0.0


def test_memory_is_bounded_and_keeps_those_who_failed_last() -> None:
    guesses = Guesses(free=1, wait_s_max=60.0)
    guesses.failed("first", 0.0)
    for number in range(KNOWN_MAX):
        guesses.failed(number, 1.0)

    assert guesses.wait_s("first", 1.0) == 0.0
    assert guesses.wait_s(KNOWN_MAX - 1, 1.0) > 0


def test_a_guesser_gets_few_tries_at_one_user_from_however_many_addresses() -> None:
    attempts, tried, now_s = Attempts(), 0, 0.0
    while now_s < 3_600:
        wait_s = attempts.begin("anna", f"10.0.0.{tried}", now_s)
        if wait_s == 0:
            tried += 1
        now_s += max(wait_s, 0.001)

    assert tried <= USER_FREE + 6 + 3_600 / USER_WAIT_S_MAX + 1


def test_a_guesser_gets_few_tries_from_one_address_at_however_many_users() -> None:
    attempts, tried, now_s = Attempts(), 0, 0.0
    while now_s < 3_600:
        wait_s = attempts.begin(f"user{tried}", "10.0.0.1", now_s)
        if wait_s == 0:
            tried += 1
        now_s += max(wait_s, 0.001)

    assert tried <= ADDRESS_FREE + 10 + 3_600 / ADDRESS_WAIT_S_MAX + 1


def test_ones_own_password_buys_no_guesses_at_others() -> None:
    attempts, guessed = Attempts(), 0
    for number in range(1_000):
        if attempts.begin("own", "10.0.0.1", 0.0) == 0:
            attempts.right("own", "10.0.0.1")
        if attempts.begin(f"other{number}", "10.0.0.1", 0.0) == 0:
            guessed += 1

    assert guessed == ADDRESS_FREE


def test_who_is_right_may_sign_in_as_often_as_wanted() -> None:
    attempts = Attempts()
    for _ in range(1_000):
        assert attempts.begin("anna", "10.0.0.1", 0.0) == 0
        attempts.right("anna", "10.0.0.1")
