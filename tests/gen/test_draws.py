"""Random numbers belong to a key: no order, no process and no type of number changes them."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fracgen import draws
from tests.command import python

KEY = st.lists(st.one_of(st.integers(-(2**40), 2**40), st.text(max_size=5)), max_size=4)


@given(KEY)
def test_equal_keys_give_equal_numbers_whatever_was_drawn_between(key: list[int | str]) -> None:
    first = draws.normal((3, 4), *key)
    torch.manual_seed(1)
    draws.normal((5,), *key, "other")
    assert torch.equal(draws.normal((3, 4), *key), first)


@given(KEY, KEY)
def test_different_keys_give_different_numbers(one: list[int | str], other: list[int | str]) -> None:
    """Also ("a", "b") and ("ab",), 1 and "1": the chance that two seeds of 63 bits meet is 1e-19."""
    same = [(type(p), p) for p in one] == [(type(p), p) for p in other]
    assert (draws.uniform(*one) == draws.uniform(*other)) is same


@pytest.mark.parametrize(("one", "other"), [(("a", "b"), ("a\0b",)), ((1, 23), (12, 3)), ((1,), ("1",)),
                                            ((0, 1, "noise"), (1, 0, "noise")), ((), ("",))])  # fmt: skip
def test_keys_that_look_alike_are_different(one: tuple[int | str, ...], other: tuple[int | str, ...]) -> None:
    assert draws.uniform(*one) != draws.uniform(*other)


def test_whole_numbers_of_numpy_and_torch_are_whole_numbers() -> None:
    """Numbers of clips come out of tensors."""
    assert draws.uniform(7, np.int64(3), "t") == draws.uniform(7, torch.tensor(3), "t") == draws.uniform(7, 3, "t")
    with pytest.raises(TypeError):
        draws.uniform(0.5)  # type: ignore[arg-type]


def test_another_process_draws_the_same() -> None:
    code = "from fracgen import draws\nprint(draws.uniform(0, 3, 'clip'), float(draws.normal((2, 2), 5, 'x').sum()))"
    there = [float(word) for word in python(code).split()]
    assert there == [draws.uniform(0, 3, "clip"), float(draws.normal((2, 2), 5, "x").sum())]


def test_normal_numbers_are_standard_normal_over_keys() -> None:
    """1000 keys of 100 numbers: the mean is within 5 / sqrt(1e5), the variance within 5 sqrt(2 / 1e5) of 1."""
    numbers = torch.stack([draws.normal((100,), 0, k, "noise") for k in range(1000)])
    assert numbers.dtype == torch.float32
    assert abs(float(numbers.mean())) < 5 * 1e5**-0.5
    assert abs(float(numbers.var()) - 1) < 5 * (2 / 1e5) ** 0.5
    assert abs(float((numbers[1:] * numbers[:-1]).mean())) < 5 * 1e5**-0.5  # neighbours do not know of each other


def test_uniform_numbers_fill_the_interval() -> None:
    """2000 keys: the largest gap of the empirical distribution is below 1.95 / sqrt(2000) with probability 0.999."""
    numbers = np.sort([draws.uniform(0, k, "sigma") for k in range(2000)])
    assert 0 <= numbers[0] <= numbers[-1] < 1
    assert np.abs(numbers - (np.arange(2000) + 0.5) / 2000).max() < 1.95 / 2000**0.5
