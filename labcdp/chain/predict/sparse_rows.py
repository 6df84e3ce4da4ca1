"""Sparse matrices whose rows are distributions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def dense_rows(rows: csr_array, low: int, high: int) -> tuple[int, NDArray[np.float64]]:
    """Rows of a sparse matrix from the first column any of them uses to the last one."""
    span = slice(rows.indptr[low], rows.indptr[high])
    columns = rows.indices[span]
    first, end = int(columns.min()), int(columns.max()) + 1
    dense = np.zeros((high - low, end - first))
    row = np.repeat(np.arange(high - low), np.diff(rows.indptr[low : high + 1]))
    dense[row, columns - first] = rows.data[span]
    return first, dense


def indicator(
    column: NDArray[Any], columns: int, row: NDArray[np.intp] | None = None, rows: int | None = None
) -> csr_array:
    """Matrix of ones in one column of each of some rows."""
    from scipy.sparse import csr_array

    row = np.arange(column.size) if row is None else row
    return csr_array((np.ones(column.size), (row, column)), shape=(rows or column.size, columns))


def spread_rows(rows: csr_array, used: NDArray[np.intp], count: int) -> csr_array:
    """Put rows in their places among `count` rows, the others empty."""
    from scipy.sparse import csr_array

    sizes = np.zeros(count, dtype=np.int64)
    sizes[used] = np.diff(rows.indptr)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    return csr_array((rows.data, rows.indices, starts), shape=(count, rows.shape[1]))
