"""Stages that overlap give the same items, and their failures where the items are taken."""

import threading

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from bscd.procedures.measuring.overlap import one_ahead, plain_linear_algebra


def test_the_items_in_their_order():
    assert list(one_ahead(iter(range(50)))) == list(range(50))
    assert list(one_ahead(one_ahead(iter("abc")))) == ["a", "b", "c"]
    assert list(one_ahead(iter(()))) == []


def test_the_next_one_is_made_while_one_is_worked_on():
    made = threading.Event()

    def items():
        yield 0
        made.set()
        yield 1

    taken = one_ahead(items())
    assert next(taken) == 0
    assert made.wait(10.0)
    assert list(taken) == [1]


def test_no_more_than_one_is_made_ahead():
    made: list[int] = []

    def items():
        for number in range(10):
            made.append(number)
            yield number

    for number in one_ahead(items()):
        assert len(made) <= number + 2
    assert len(made) == 10


def test_a_failure_is_raised_after_the_items_before_it():
    def items():
        yield from (1, 2)
        raise OSError("the disk is gone")

    taken: list[int] = []
    with pytest.raises(OSError, match="the disk is gone"):
        for number in one_ahead(items()):
            taken.append(number)
    assert taken == [1, 2]


def test_leaving_early_ends_the_thread_and_closes_what_it_takes_from():
    closed = threading.Event()

    def items():
        try:
            yield from range(100)
        finally:
            closed.set()

    before = threading.active_count()
    taken = one_ahead(items())
    assert next(taken) == 0
    taken.close()
    del taken
    assert closed.wait(10.0)
    assert threading.active_count() == before


def blas_threads():
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_linear_algebra_has_its_threads_back_when_the_last_one_leaves():
    assert np.linalg.norm(np.eye(3) @ np.eye(3)) > 1.0  # loads it
    with threadpool_limits(2):
        before = blas_threads()
        assert before
        assert set(before) == {2}
        first, second = plain_linear_algebra(), plain_linear_algebra()
        first.__enter__()
        second.__enter__()
        assert set(blas_threads()) == {1}
        first.__exit__(None, None, None)
        assert set(blas_threads()) == {1}
        second.__exit__(None, None, None)
        assert blas_threads() == before
