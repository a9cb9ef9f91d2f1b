"""Each part writes to its own slots, and folding the slots gives the plain sum."""

from unittest import mock

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from skfem_stvk.edges.topology import shares_of
from skfem_stvk.kernels import threads as kernel_threads
from skfem_stvk.kernels.node_blocks import fold
from skfem_stvk.kernels.threads import parts_of

SEEDS = st.integers(0, 10**6)


def random_targets(seed, rows, width, size):
    """Return rows of targets that share near targets more often than far ones, like elements of a mesh."""
    rng = np.random.default_rng(seed)
    centre = np.linspace(0, size, rows, endpoint=False)[:, None]
    return ((centre + rng.normal(0, 0.2 * size, (rows, width))).astype(np.int64) % size).astype(np.uint32)


def shared(targets, size, threads):
    """Return shares with any amount of work per part."""
    with mock.patch.object(kernel_threads, "SMALLEST_PART", 1):
        return shares_of(targets, size, 1, threads)


@settings(max_examples=60)
@given(seed=SEEDS, rows=st.integers(1, 40), width=st.integers(1, 5), size=st.integers(1, 30), threads=st.integers(1, 5))
def test_no_two_parts_share_a_slot(seed, rows, width, size, threads):
    targets = random_targets(seed, rows, width, size)
    shares = shared(targets, size, threads)
    slots = shares.slots.reshape(targets.shape)
    used = [set(slots[begin:end].ravel().tolist()) for begin, end in zip(shares.parts, shares.parts[1:], strict=False)]
    assert len(used) == min(threads, rows)
    assert sum(map(len, used)) == len(set().union(*used))
    assert max(map(max, used)) < size + len(shares.extra)


@settings(max_examples=60)
@given(
    seed=SEEDS,
    rows=st.integers(1, 40),
    size=st.integers(1, 30),
    threads=st.integers(1, 5),
    width=st.sampled_from([1, 3, 9]),
    dtype=st.sampled_from([np.float64, np.float32]),
)
def test_folding_gives_the_plain_sum(seed, rows, size, threads, width, dtype):
    """The values are whole numbers, so that the order of summation does not matter."""
    targets = random_targets(seed, rows, 4, size)
    shares = shared(targets, size, threads)
    values = np.random.default_rng(seed).integers(-99, 99, (targets.size, width)).astype(dtype)
    plain, slots = np.zeros((size, width), dtype), np.zeros((size + len(shares.extra), width), dtype)
    np.add.at(plain, targets.ravel(), values)
    np.add.at(slots, shares.slots, values)
    fold(slots.reshape(-1), size, shares.extra, width)
    assert np.array_equal(slots[:size], plain)


@pytest.mark.few
@pytest.mark.parametrize("count", [0, 1, 7, 128, 1000])
@pytest.mark.parametrize("threads", [1, 2, 3, 64])
def test_parts_cover_all_rows_once_and_have_equal_sizes(count, threads):
    parts = parts_of(count, 16, threads)
    assert parts[0] == 0 and parts[-1] == count and parts.dtype == np.int64
    assert 1 <= len(parts) - 1 <= threads
    sizes = np.diff(parts)
    assert sizes.max() - sizes.min() <= 1
    assert len(sizes) == 1 or 16 * (sizes.min() + 1) > kernel_threads.SMALLEST_PART


def test_small_work_is_not_shared():
    assert len(parts_of(2 * kernel_threads.SMALLEST_PART - 1, 1, 8)) == 2
    assert len(parts_of(2 * kernel_threads.SMALLEST_PART, 1, 8)) == 3
    assert len(parts_of(2 * kernel_threads.SMALLEST_PART // 16, 16, 8)) == 3


def test_one_part_uses_no_extra_slots():
    targets = random_targets(0, 9, 4, 12)
    shares = shares_of(targets, 12, 16, 8)
    assert np.shares_memory(shares.slots, targets) and len(shares.extra) == 0
