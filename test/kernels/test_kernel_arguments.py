"""Whatever a compiled kernel is given, it answers or raises; what it takes, it says itself."""

import inspect
import re
import sys
from functools import cache

import numpy as np
import pytest

from plsing_ros.kernels import compiled, of_numpy

# Also those that `kernels` does not name.
KERNELS = sorted(name for name in dir(compiled) if callable(getattr(compiled, name)) and not name.startswith("__"))
EVERY = pytest.mark.parametrize("name", KERNELS)
MOST_ELEMENTS = 500
WRONG_TYPES = None, "text", b"12345678", object(), [1.0, 2.0, 3.0], {}, 1j


def kinds(name):
    """The types of the arguments: "int", "float", or else arrays."""
    return [each.annotation for each in inspect.signature(getattr(of_numpy, name)).parameters.values()]


def with_arrays(name, arrays):
    """The arguments of a kernel, given its arrays; numbers are 1."""
    numbers = {"int": 1, "float": 1.0}
    return [numbers[kind] if kind in numbers else next(arrays) for kind in kinds(name)]


def of_sizes(name, sizes):
    """Arguments with arrays of one row; one element of each is not negative: where those are counted, one per row."""
    return with_arrays(name, (np.array([[1.0] + [-1.0] * (size - 1)]) for size in sizes))


@cache
def smallest_sizes(name):
    """Return numbers of elements of arrays that are taken, found by asking the kernel.

    It says which array does not fit: the one that is then made longer.
    """
    for first in range(1, MOST_ELEMENTS):
        sizes = [first] + [1] * (len(kinds(name)) - 1)
        while max(sizes) < MOST_ELEMENTS:
            try:
                getattr(compiled, name)(*of_sizes(name, sizes))
            except ValueError as refusal:
                wrong = re.match(r"array (\d+) ", str(refusal))
                if wrong is None or wrong[1] == "0":
                    break
                sizes[int(wrong[1])] += 1
            else:
                return sizes
    raise AssertionError(f"{name} takes no arrays of up to {MOST_ELEMENTS} elements")


@pytest.fixture
def arguments(name):
    return of_sizes(name, smallest_sizes(name))


def outcome(name, arguments):
    """Return what is raised, or None; no array that was given may be held any longer."""
    arrays = [each for each in arguments if isinstance(each, np.ndarray)]
    references = [sys.getrefcount(each) for each in arrays]
    try:
        getattr(compiled, name)(*arguments)
        raised = None
    except (BufferError, TypeError, ValueError) as error:
        raised = error.with_traceback(None)
    assert raised is None or str(raised)
    assert [sys.getrefcount(each) for each in arrays] == references
    return raised


def replaced(arguments, i, other):
    return [*arguments[:i], other, *arguments[i + 1 :]]


@EVERY
def test_what_fits_is_taken_and_nothing_is_held_afterwards(name, arguments):
    assert outcome(name, arguments) is None


@EVERY
def test_any_other_number_of_arguments_is_a_type_error(name, arguments):
    for count in {*range(len(arguments) + 4)} - {len(arguments)}:
        raised = outcome(name, (arguments * 3)[:count])
        assert isinstance(raised, TypeError)
        assert str(raised) == f"{count} arguments given, {len(arguments)} expected"


@EVERY
def test_other_types_are_refused(name, arguments):
    for i, argument in enumerate(arguments):
        for other in WRONG_TYPES:
            assert outcome(name, replaced(arguments, i, other)) is not None
        if isinstance(argument, np.ndarray):
            for other in (np.float32, np.int64, np.complex64, np.longdouble, ">f8", object, "S8", "V8"):
                assert isinstance(outcome(name, replaced(arguments, i, np.ones(argument.shape, other))), ValueError)
            assert outcome(name, replaced(arguments, i, 1.0)) is not None
        else:
            assert outcome(name, replaced(arguments, i, np.ones(3))) is not None


@EVERY
def test_other_sizes_and_layouts_are_refused(name, arguments):
    for i, argument in enumerate(arguments):
        if not isinstance(argument, np.ndarray):
            continue
        longer, strided = np.ones((1, argument.size + 1)), np.ones((1, 2 * argument.size + 2))
        assert isinstance(outcome(name, replaced(arguments, i, longer)), ValueError)
        assert isinstance(outcome(name, replaced(arguments, i, argument[:, 1:])), ValueError)
        with pytest.raises(ValueError, match="not C-contiguous"):
            getattr(compiled, name)(*replaced(arguments, i, strided[:, ::2]))


@EVERY
def test_what_is_read_only_is_refused_or_left_as_it_is(name, arguments):
    # Not what an earlier call has filled in.
    for i, before in enumerate([0.7 * each for each in arguments]):
        if not isinstance(before, np.ndarray):
            continue
        protected = before.copy()
        protected.setflags(write=False)
        raised = outcome(name, replaced(arguments, i, protected))
        assert raised is None or "read-only" in str(raised)
        np.testing.assert_array_equal(protected, before)


@EVERY
def test_arrays_of_any_one_shape_are_answered_or_refused(name):
    for shape in ((), (0,), (0, 3), (1, 0), (3, 0), (2, 3), (3, 3, 3)):
        outcome(name, with_arrays(name, (np.ones(shape) for _ in kinds(name))))


@EVERY
def test_any_elements_are_answered_or_refused(name, arguments):
    for i, argument in enumerate(arguments):
        for value in (0.0, -1.0, 1e-320, 1e308, np.nan, np.inf, -np.inf):
            if isinstance(argument, np.ndarray):
                outcome(name, replaced(arguments, i, np.full_like(argument, value)))
