"""A sweep as a dataset that shows its numbers."""

from __future__ import annotations

import math
import textwrap

import numpy as np
import xarray

from .record import headed

__all__ = ["SweepDataset"]

MOST_CASES = 60
"""A sweep with more cases is shown as xarray shows it."""

SHOWN = ("cycles", "period", "peak_force", "valley_force", "swing", "slip_length", "result_code")
"""Values that are shown, if a case has them."""


class SweepDataset(xarray.Dataset):  # type: ignore[no-untyped-call]
    """An `xarray.Dataset` with the summary of every case, which prints a small sweep as a table."""

    __slots__ = ()

    def __repr__(self) -> str:
        if not (self.coords and "result_code" in self and 0 < self["result_code"].size <= MOST_CASES):
            return super().__repr__()
        like = self["result_code"]
        if not {dim for name in self.coords for dim in self[name].dims} <= set(like.dims):
            return super().__repr__()
        columns = []
        for name in [*self.coords, *(name for name in SHOWN if name in self)]:
            values = np.asarray(self[name].broadcast_like(like)).reshape(-1)
            if name == "result_code" and not np.any(values):
                continue
            if values.dtype.kind == "f" and np.all(np.isnan(values)):
                continue
            head = headed(str(name), str(self[name].attrs.get("units", "")))
            columns.append([head, *(_shown(value) for value in values.tolist())])
        widths = [max(map(len, column)) for column in columns]
        rows = [
            "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
            for row in zip(*columns, strict=True)
        ]
        failed = int(np.count_nonzero(like))
        state = f", {failed} not done: see result_text" if failed else ""
        others = ", ".join(str(name) for name in self.data_vars if name not in SHOWN)
        also = textwrap.wrap(
            f"also: {others}", max(80, sum(widths) + 2 * len(widths)), subsequent_indent="      "
        )
        return "\n".join([f"<sweep: {like.size} case{'' if like.size == 1 else 's'}{state}>", *rows, *also])


def _shown(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.5g}"
