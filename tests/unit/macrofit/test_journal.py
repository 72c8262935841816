"""The journal gives back what it was given, whatever moment the run was killed at."""

from __future__ import annotations

import dataclasses
import resource
from contextlib import contextmanager

import msgspec
import numpy as np
import pytest
from fakes import fake_increment, fake_scene

from macrofit.errors import OutputError
from macrofit.results.journal import MAGIC, Journal, is_journal


def state(k: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(100 + k)
    return {
        "load": rng.standard_normal(5 + k),
        "history": np.asfortranarray(rng.random((3, 4))),
        "status": rng.integers(-9, 9, 4 * k),
        "odd": np.array([np.nan, np.inf, -0.0, 5e-324]),
    }


def written(path, count=3, scene=None):
    records = [fake_increment(k, 2.0 * k, 1e5 * k / 3.0) for k in range(count)]
    with Journal.start(path, scene or fake_scene()) as journal:
        for k, record in enumerate(records):
            journal.append(record, state(k))
    return records


def assert_same(record, expected):
    for field in dataclasses.fields(expected):
        if field.name != "facets":
            value = getattr(expected, field.name)
            assert type(getattr(record, field.name)) is type(value)
            assert getattr(record, field.name) == pytest.approx(value, rel=0.0, abs=0.0, nan_ok=True)
    for field in dataclasses.fields(expected.facets):
        assert_same_array(getattr(record.facets, field.name), getattr(expected.facets, field.name))


def assert_same_array(array, expected):
    assert array.dtype == expected.dtype
    assert array.shape == expected.shape
    assert array.tobytes() == expected.tobytes()
    assert array.flags.writeable


@contextmanager
def disk_of(size: int):
    """Files cannot grow beyond ``size`` bytes: the error of a full disk without a disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_everything_comes_back_to_the_bit(tmp_path):
    path = tmp_path / "journal.bin"
    expected = written(path)
    assert is_journal(path)
    with Journal.resume(path, fake_scene()) as journal:
        found = journal.records()
    assert len(found) == len(expected)
    for k, ((record, arrays), before) in enumerate(zip(found, expected, strict=True)):
        assert_same(record, before)
        assert arrays.keys() == state(k).keys()
        for name, array in state(k).items():
            assert_same_array(arrays[name], array)


def test_numbers_of_numpy_are_stored_as_plain_ones(tmp_path):
    record = dataclasses.replace(
        fake_increment(0, 1.0, 2.0),
        force=np.float64(0.1),
        active_facets=np.int64(7),
        converged=np.bool_(True),
    )
    with Journal.start(tmp_path / "j", fake_scene()) as journal:
        journal.append(record, {})
    with Journal.resume(tmp_path / "j", fake_scene()) as journal:
        found = journal.records()[0][0]
    assert (found.force, found.active_facets, found.converged) == (0.1, 7, True)
    assert type(found.force) is float


def test_a_kill_at_any_byte_costs_the_last_record_at_most(tmp_path):
    path = tmp_path / "journal.bin"
    written(path, count=2)
    data = path.read_bytes()
    with Journal.start(tmp_path / "empty", fake_scene()):
        head = (tmp_path / "empty").stat().st_size
    ends = [head]
    with Journal.start(tmp_path / "ends", fake_scene()) as journal:
        for k in range(2):
            journal.append(fake_increment(k, 2.0 * k, 1e5 * k / 3.0), state(k))
            ends.append((tmp_path / "ends").stat().st_size)
    assert ends[-1] == len(data)
    for size in range(head, len(data), 31):
        path.write_bytes(data[:size])
        with Journal.resume(path, fake_scene()) as journal:
            whole = sum(end <= size for end in ends) - 1
            assert len(journal.records()) == whole
            assert path.stat().st_size == ends[whole]
    path.write_bytes(data[: ends[1]] + bytes(50))  # space that a power cut left reserved and never filled
    with Journal.resume(path, fake_scene()) as journal:
        assert len(journal.records()) == 1


def test_appending_goes_on_after_a_torn_record(tmp_path):
    path = tmp_path / "journal.bin"
    expected = written(path)
    path.write_bytes(path.read_bytes()[:-11])
    with Journal.resume(path, fake_scene()) as journal:
        assert len(journal.records()) == 2
        journal.append(expected[2], state(2))
    with Journal.resume(path, fake_scene()) as journal:
        assert_same(journal.records()[2][0], expected[2])


def test_damage_before_the_end_is_refused(tmp_path):
    path = tmp_path / "journal.bin"
    written(path)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(OutputError, match=r"journal\.bin: damaged at byte \d+, after \d+ increments"):
        Journal.resume(path, fake_scene())


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "not a journal"), (b"something else", "not a journal"), (MAGIC, "header is damaged")],
)
def test_a_foreign_file_is_refused(tmp_path, content, message):
    path = tmp_path / "journal.bin"
    path.write_bytes(content)
    with pytest.raises(OutputError, match=message):
        Journal.resume(path, fake_scene())


def test_another_scene_is_refused_by_the_keys_that_changed(tmp_path):
    path = tmp_path / "journal.bin"
    written(path)
    with pytest.raises(OutputError, match=r"of another scene \(changed: motion\.travel\)"):
        Journal.resume(path, fake_scene(travel=16.0, increment=2.0))


def test_a_changed_mesh_file_is_another_scene(tmp_path):
    mesh = tmp_path / "axle.msh"
    mesh.write_text("one")
    scene = fake_scene()
    scene = msgspec.structs.replace(scene, mesh=msgspec.structs.replace(scene.mesh, axle=str(mesh)))
    written(tmp_path / "j", scene=scene)
    Journal.resume(tmp_path / "j", scene).close()
    mesh.write_text("two")
    with pytest.raises(OutputError, match=r"content of mesh\.axle"):
        Journal.resume(tmp_path / "j", scene)


def test_an_unfinished_run_of_the_same_scene_is_not_replaced(tmp_path):
    path = tmp_path / "journal.bin"
    written(path)
    with pytest.raises(OutputError, match=r"unfinished run of this scene, 3 increments; .*--resume"):
        Journal.start(path, fake_scene())
    with Journal.resume(path, fake_scene()) as journal:
        assert len(journal.records()) == 3
    Journal.start(path, fake_scene(travel=4.0)).close()  # of another scene: replaced
    with Journal.resume(path, fake_scene(travel=4.0)) as journal:
        assert journal.records() == []
    written(path, scene=fake_scene(travel=4.0))  # not a single increment so far: replaced
    Journal.start(path, fake_scene(travel=4.0), replace=True).close()  # a finished run: replaced


def test_two_runs_do_not_write_the_same_journal(tmp_path):
    path = tmp_path / "journal.bin"
    with Journal.start(path, fake_scene()):
        with pytest.raises(OutputError, match="another process is writing it"):
            Journal.start(path, fake_scene(), replace=True)
        with pytest.raises(OutputError, match="another process is writing it"):
            Journal.resume(path, fake_scene())
    Journal.resume(path, fake_scene()).close()


def test_a_full_disk_is_said_and_keeps_what_was_written(tmp_path):
    path = tmp_path / "journal.bin"
    with Journal.start(path, fake_scene()) as journal:
        journal.append(fake_increment(0, 0.0, 0.0), state(0))
        size = path.stat().st_size
        with (
            disk_of(size + 100),
            pytest.raises(OutputError, match=r"journal\.bin: cannot be written: .*--resume"),
        ):
            journal.append(fake_increment(1, 2.0, 1.0), state(1))
        assert path.stat().st_size == size
        journal.append(fake_increment(1, 2.0, 1.0), state(1))
    with Journal.resume(path, fake_scene()) as journal:
        assert len(journal.records()) == 2


def test_ranks_that_do_not_write_have_an_empty_journal():
    with Journal.elsewhere() as journal:
        journal.append(fake_increment(0, 0.0, 0.0), {})
        assert journal.records() == []
