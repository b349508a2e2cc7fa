"""The table of a study: one row per run, in Parquet files.

A batch of finished runs becomes one small file under ``parts``. Every file is written under another
name and then renamed, so that only whole files exist, however the program ends. When the study is
complete, or when there are many parts, they are merged into ``table.parquet``, sorted by cell and
seed, a bounded number of rows at a time. ``study.json`` says to which study, configuration and code
the table belongs. A directory that belongs to another study is refused and left unchanged.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from encircle.protocol.process.directories import unusable
from encircle.studies.plan import Plan, StudyError
from encircle.studies.study_directory import (
    LOCK_FILE,
    OWNER_FILE,
    PARTS_DIRECTORY,
    TABLE_FILE,
    flush,
    lock_file,
    owner_of,
    write_file,
)
from encircle.studies.tasks import FAILED

if TYPE_CHECKING:
    import pyarrow.dataset as ds

KEY_COLUMNS = ("cell", "seed", FAILED)
PARTS_MAX = 512
MERGED_ROWS = 20_000


class StudyTable:
    """The table in a directory, locked for this process until ``close``.

    ``done``: (C, S) whether the table has the run of a cell with a seed. ``failed``: (C, S)
    whether it has only a failed run of them, which is then run again. Raises ``StudyError`` if
    the directory belongs to another study, cannot be written, or has damaged files.
    """

    def __init__(self, directory: Path, plan: Plan, code: Mapping[str, str]) -> None:
        self.directory = directory
        self.owner = {
            "study": plan.name,
            "fingerprint": plan.fingerprint,
            **code,
        }
        self._plan = plan
        self._seed_index = {seed: k for k, seed in enumerate(plan.seed_list)}
        existing = owner_of(directory)
        if existing is not None:
            self._refuse_foreign(existing)
        try:
            (directory / PARTS_DIRECTORY).mkdir(parents=True, exist_ok=True)
            self._lock = lock_file(directory / LOCK_FILE)
            if existing is None:
                tree = {**self.owner, "plan": plan.model_dump(mode="json")}
                write_file(directory / OWNER_FILE, json.dumps(tree, indent=2).encode() + b"\n")
        except OSError as error:
            raise StudyError(unusable(directory, error)) from None
        try:
            self.done, self.failed = self._read_done()
        except StudyError:
            self.close()
            raise
        for left in directory.rglob("*.tmp"):
            left.unlink()
        self._numbers = [int(path.stem) for path in self._parts()]

    def close(self) -> None:
        """Release the lock. May be called twice."""
        self._lock.close()

    def append(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Add finished runs; they are on disk when this returns."""
        number = max(self._numbers, default=0) + 1
        table = pa.Table.from_pylist(list(rows), schema=self._schema(rows[0]))
        _write_table(self.directory / PARTS_DIRECTORY / f"{number:08}.parquet", [table], "none")
        self._numbers.append(number)
        for row in rows:
            seed_index = self._seed_index[row["seed"]]
            assert not self.done[row["cell"], seed_index], (
                f"run {row['cell']}, {row['seed']} came twice"
            )
            self.done[row["cell"], seed_index] = not row[FAILED]
            self.failed[row["cell"], seed_index] = bool(row[FAILED])
        if len(self._numbers) >= PARTS_MAX:
            self.merge()

    def merge(self) -> None:
        """Merge all files into one, sorted; the old files stay until the new one is complete."""
        parts = self._parts()
        if not parts:
            return
        source = self._dataset()
        per_cell = max(1, self._plan.runs // len(self._plan.cells))
        step = max(1, MERGED_ROWS // per_cell)
        pieces = (
            _sorted_rows(source, cell, cell + step)
            for cell in range(0, len(self._plan.cells), step)
        )
        _write_table(self.directory / TABLE_FILE, pieces)
        for path in parts:
            path.unlink()
        self._numbers = []

    def read(self, columns: Sequence[str] | None = None, cells: slice | None = None) -> pa.Table:
        """The rows of some cells (all by default), sorted by cell and seed, each run once."""
        span = cells or slice(0, len(self._plan.cells))
        rows = _sorted_rows(self._dataset(), span.start, span.stop, columns)
        # The table may hold more seeds, from an earlier call.
        return rows.filter(pc.is_in(rows["seed"], pa.array(self._plan.seed_list)))

    @property
    def complete_seeds(self) -> list[int]:
        """The seeds whose run is there in every cell, which can be compared in pairs."""
        return [self._plan.seed_list[k] for k in np.flatnonzero(self.done.all(axis=0))]

    def failures(self, rows_max: int) -> list[dict[str, Any]]:
        """The first ``rows_max`` rows of failed runs."""
        names = ["cell", "seed", *(axis.name for axis in self._plan.all_axes), FAILED]
        failed_rows: list[dict[str, Any]] = []
        for cell in np.flatnonzero(self.failed.any(axis=1)).tolist():
            rows = self.read(names, slice(cell, cell + 1))
            failed_rows += rows.filter(pc.not_equal(rows[FAILED], "")).to_pylist()
            if len(failed_rows) >= rows_max:
                break
        return failed_rows[:rows_max]

    def _parts(self) -> list[Path]:
        return sorted((self.directory / PARTS_DIRECTORY).glob("*.parquet"))

    def _dataset(self) -> "ds.Dataset":
        # Imported late: it brings pandas, and runs can begin without.
        import pyarrow.dataset as ds

        whole = self.directory / TABLE_FILE
        files = [*([whole] if whole.exists() else []), *self._parts()]
        return ds.dataset([str(path) for path in files], format="parquet")

    def _schema(self, row: Mapping[str, Any]) -> pa.Schema:
        kinds = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
        named = [(name, kinds[type(value)]) for name, value in row.items()]
        return pa.schema(named, {key: str(value) for key, value in self.owner.items()})

    def _read_done(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        done, failed = np.zeros((2, len(self._plan.cells), len(self._plan.seed_list)), bool)
        whole = self.directory / TABLE_FILE
        for path in [*([whole] if whole.exists() else []), *self._parts()]:
            rows = self._read_keys(path)
            columns = (rows[name].to_pylist() for name in KEY_COLUMNS)
            for cell, seed, failure in zip(*columns, strict=True):
                seed_index = self._seed_index.get(seed)
                if seed_index is not None and 0 <= cell < len(done):
                    (failed if failure else done)[cell, seed_index] = True
        return done, failed & ~done

    def _read_keys(self, path: Path) -> pa.Table:
        try:
            with pq.ParquetFile(path) as file:
                claimed = {
                    k.decode(): v.decode() for k, v in (file.schema_arrow.metadata or {}).items()
                }
                rows = file.read(columns=list(KEY_COLUMNS))
        except (pa.ArrowException, OSError, KeyError) as error:
            line = (str(error).splitlines() or [type(error).__name__])[0]
            raise StudyError(
                f"{path} is damaged ({line}): delete it to have its runs repeated;"
                " nothing was changed"
            ) from None
        self._refuse_foreign(claimed, path)
        return rows

    def _refuse_foreign(self, claimed: Mapping[str, Any], path: Path | None = None) -> None:
        for key, expected in self.owner.items():
            if str(claimed.get(key)) != str(expected):
                what = {"fingerprint": "configuration"}.get(key, key)
                raise StudyError(
                    f"{path or self.directory} holds runs of {what} {claimed.get(key)!r}, this is"
                    f" {expected!r}: choose another --out; nothing was changed"
                )


def _sorted_rows(
    source: "ds.Dataset", first: int, after: int, columns: Sequence[str] | None = None
) -> pa.Table:
    names = None if columns is None else list(dict.fromkeys([*KEY_COLUMNS, *columns]))
    chosen = (pc.field("cell") >= first) & (pc.field("cell") < after)
    # If a run failed and was repeated, the row without a failure comes first.
    rows = source.to_table(columns=names, filter=chosen).sort_by(
        [(k, "ascending") for k in KEY_COLUMNS]
    )
    # An interrupted merge leaves parts whose rows are in the merged table too.
    cells, seeds = rows["cell"].to_numpy(), rows["seed"].to_numpy()
    first_of = np.ones(len(cells), bool)
    first_of[1:] = (cells[1:] != cells[:-1]) | (seeds[1:] != seeds[:-1])
    return rows if first_of.all() else rows.filter(pa.array(first_of))


def _write_table(path: Path, pieces: Iterable[pa.Table], compression: str = "zstd") -> None:
    """Write tables to a file that gets its name only when it is complete.

    A few rows take longer to compress than to write.
    """
    aside = path.with_suffix(".tmp")
    writer = None
    with open(aside, "wb") as file:
        for piece in pieces:
            writer = writer or pq.ParquetWriter(file, piece.schema, compression=compression)
            writer.write_table(piece)
        if writer is not None:
            writer.close()
        flush(file)
    aside.replace(path)
