"""Forces and lengths of long motions: the bits of short ones, whole files or none, in bounded memory."""

import math
import threading
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from cases import random_mechanism, random_motion
from texts import ACCELERATIONS, TWIST, put, table

import sixsps
from compare import inputs
from compare.inputs import WholeMotion, load_motion, open_motions
from compare.single import forces_calculation, lengths_calculation
from compare.streaming import ahead, in_order, stream
from sixsps.errors import EngineError, MotionError, OutputError
from sixsps.formulations.newton_euler import joint_reactions
from sixsps.kernels.model import CompiledMechanism
from sixsps.motion import Motion
from sixsps.motion_stream import MotionStream, open_motion

SAMPLES = 50
SIZES = (1, 3, 16, 49, 50, 1000)
FORCES = [f"f{leg}" for leg in range(1, 7)]


def silent(*_):
    pass


class TestAhead:
    def test_items_come_in_order(self):
        assert list(ahead((i for i in range(100)), 3)) == list(range(100))

    def test_no_more_are_taken_than_was_said(self):
        taken = []
        for given, item in enumerate(ahead((taken.append(i) or i for i in range(100)), 5)):
            assert item == given
            assert len(taken) <= given + 1 + 5

    def test_an_error_comes_in_its_place(self):
        items = ahead((1 / (3 - i) for i in range(10)), 4)
        assert [next(items) for _ in range(3)] == [1 / 3, 1 / 2, 1]
        with pytest.raises(ZeroDivisionError):
            next(items)

    def test_who_stops_ends_the_thread_and_the_source(self):
        ended = []

        def source():
            try:
                yield from range(10**9)
            finally:
                ended.append(True)

        before = threading.active_count()
        items = ahead(source(), 4)
        assert next(items) == 0
        items.close()
        assert ended == [True]
        assert threading.active_count() == before


class TestInOrder:
    def test_results_come_in_the_order_of_the_items_whichever_is_ready_first(self):
        ready = [threading.Event() for _ in range(30)]

        def function(item):
            if item % 2 == 0:
                assert ready[item + 1].wait(10)
            ready[item].set()
            return item

        assert list(in_order(function, (i for i in range(30)), 2)) == list(range(30))

    def test_an_error_comes_after_the_results_before_it_and_ends_all(self):
        def function(item):
            if item == 5:
                raise EngineError("five")
            return item

        before = threading.active_count()
        found = []
        with pytest.raises(EngineError):
            found.extend(in_order(function, (i for i in range(10**9)), 3))
        results = in_order(function, (i for i in range(10**9)), 3)
        assert [next(results) for _ in range(5)] == list(range(5))
        with pytest.raises(EngineError, match="five"):
            next(results)
        assert threading.active_count() == before


@pytest.fixture(scope="module")
def mechanism():
    return random_mechanism(3)


@pytest.fixture(scope="module")
def states(mechanism):
    return random_motion(mechanism, 3, SAMPLES)


def written(motions, calculation, path, size):
    """Returns the columns of the file, and what is said of singular samples."""
    singular = stream(motions, replace(calculation, block=size), path, silent)
    columns = pa.parquet.read_table(path).to_pydict()
    assert list(columns) == ["t", *calculation.quantities]
    return {name: np.array(values) for name, values in columns.items()}, singular


def assert_same_bits(columns, expected):
    assert np.column_stack(list(columns.values())).tobytes() == np.column_stack(expected).tobytes()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("streamed", [False, True])
class TestBits:
    @pytest.fixture
    def motions(self, tmp_path, states, streamed):
        states.save(tmp_path / "motion.parquet")
        return open_motion(tmp_path / "motion.parquet") if streamed else WholeMotion(states)

    def test_of_fast(self, tmp_path, mechanism, states, motions, size):
        found, _ = written(
            motions, forces_calculation("fast", mechanism, False), tmp_path / "f.parquet", size
        )
        assert_same_bits(found, [states.time, sixsps.compile(mechanism).inverse_dynamics(states)])

    def test_of_reactions(self, tmp_path, mechanism, states, motions, size):
        found, _ = written(motions, forces_calculation(None, mechanism, True), tmp_path / "f.parquet", size)
        whole = joint_reactions(mechanism, states)
        joints = [array.reshape(SAMPLES, 18) for array in (whole.base, whole.platform)]
        assert_same_bits(found, [states.time, whole.forces, *joints])

    @pytest.mark.parametrize("rates", [False, True])
    def test_of_lengths(self, tmp_path, mechanism, states, motions, size, rates):
        found, _ = written(motions, lengths_calculation(mechanism, rates), tmp_path / "l.parquet", size)
        legs = sixsps.inverse_kinematics(mechanism, states)
        assert_same_bits(found, [states.time, legs.lengths, *([legs.length_rates] if rates else [])])


@pytest.mark.parametrize("engine", ["kane", "pinocchio"])
def test_bits_of_an_engine_in_processes(tmp_path, mechanism, states, engine):
    calculation = forces_calculation(engine, mechanism, False)
    parts, _ = written(WholeMotion(states), calculation, tmp_path / "parts.parquet", 30)
    whole, _ = written(WholeMotion(states), calculation, tmp_path / "whole.parquet", SAMPLES)
    assert_same_bits(parts, list(whole.values()))


def test_an_engine_in_processes_tells_how_many_samples_are_done_of_all(tmp_path, mechanism, states):
    told = []
    calculation = replace(forces_calculation("kane", mechanism, False), block=30)
    stream(WholeMotion(states), calculation, tmp_path / "f.csv", lambda *news: told.append(news))
    done = [number for _, _, number in told]
    assert done == sorted(done)
    assert done[-1] == SAMPLES
    assert {state for _, state, _ in told} <= {"starting", "running"}


def flattened(motion, rows):
    """The same motion with all joints in one plane at some samples."""
    position = np.array(motion.position)
    position[rows] = [0.01, 0.02, 0.0]
    quaternion = np.array(motion.quaternion)
    quaternion[rows] = [1, 0, 0, 0]
    return replace(motion, position=position, quaternion=quaternion)


class TestSingularSamples:
    @pytest.mark.parametrize("size", [1, 7, 16, 1000])
    @pytest.mark.parametrize("what", ["fast", "reactions"])
    def test_are_nan_and_told_by_their_number_in_the_whole(self, tmp_path, wu2012, what, size):
        rows = [0, 6, 7, 20, 49]
        motion = flattened(random_motion(wu2012, 0, SAMPLES, tilt=0.2), rows)
        calculation = forces_calculation("fast" if what == "fast" else None, wu2012, what == "reactions")
        columns, singular = written(WholeMotion(motion), calculation, tmp_path / "f.parquet", size)
        values = np.column_stack([columns[name] for name in calculation.quantities])
        assert np.flatnonzero(np.isnan(values).all(axis=1)).tolist() == rows
        assert np.isfinite(np.delete(values, rows, axis=0)).all()
        assert singular.number == 5
        starts = [line.split(" is singular: cond(J) is ")[0] for line in singular.lines()]
        assert starts == [f"sample {row + 1} at t = {row} s" for row in rows]

    def test_are_told_in_a_few_lines_however_many_there_are(self, tmp_path, wu2012):
        motion = flattened(random_motion(wu2012, 0, SAMPLES), slice(2, None))
        calculation = forces_calculation("fast", wu2012, False)
        columns, singular = written(WholeMotion(motion), calculation, tmp_path / "f.parquet", 7)
        assert np.isnan(columns["f3"]).sum() == singular.number == SAMPLES - 2
        assert len(singular.lines()) == 6
        assert singular.lines()[-1] == "and 43 more singular samples"

    def test_are_not_told_where_there_are_none(self, tmp_path, mechanism, states):
        calculation = forces_calculation("fast", mechanism, False)
        _, singular = written(WholeMotion(states), calculation, tmp_path / "f.parquet", 7)
        assert (singular.number, singular.lines()) == (0, [])

    def test_a_force_that_is_lost_is_no_singular_sample(self, tmp_path, mechanism, states, monkeypatch):
        def loses_one(model, motion):
            forces = model.__class__.equations(model, motion)[1]
            forces[motion.time == 33, 2] = math.nan
            return forces

        monkeypatch.setattr(CompiledMechanism, "inverse_dynamics", loses_one)
        calculation = replace(forces_calculation("fast", mechanism, False), block=8)
        with pytest.raises(EngineError, match=r"engine fast: a force at t = 33 s is not a number"):
            stream(WholeMotion(states), calculation, tmp_path / "f.parquet", silent)
        assert list(tmp_path.iterdir()) == []


class TestNothingIsLeftHalfWritten:
    def ends(self, motions, calculation, path, error, match):
        path.write_text("precious")
        before = threading.active_count()
        with pytest.raises(error, match=match):
            stream(motions, replace(calculation, block=7), path, silent)
        assert path.read_text() == "precious"
        assert not [file.name for file in path.parent.iterdir() if file.name.startswith(".")]
        assert threading.active_count() == before

    def test_by_a_bad_row_in_the_last_block(self, tmp_path, wu2012):
        motion = put(tmp_path, table(40, z=[0.5] * 39 + [math.nan]), "parquet")
        calculation = forces_calculation("fast", wu2012, False)
        self.ends(
            open_motion(motion), calculation, tmp_path / "f.parquet", MotionError, "z, row 40: nan; allowed"
        )

    def test_by_a_file_that_ends_too_early(self, tmp_path, wu2012):
        path = tmp_path / "path.parquet"
        pa.parquet.write_table(pa.table(table(40)), path, row_group_size=10, compression="none")
        motions = open_motion(path)
        path.write_bytes(path.read_bytes()[:1000])
        self.ends(
            motions, lengths_calculation(wu2012, False), tmp_path / "l.csv", MotionError, "a Parquet file"
        )

    def test_by_an_engine_that_fails(self, tmp_path, wu2012):
        def fails(motion, _watch):
            raise EngineError("engine fast: no")

        calculation = replace(forces_calculation("fast", wu2012, False), calculate=fails)
        motion = WholeMotion(random_motion(wu2012, 0, 40))
        self.ends(motion, calculation, tmp_path / "f.parquet", EngineError, "^engine fast: no$")

    def test_by_an_error_that_is_not_of_the_output_and_is_not_told_as_such(self, tmp_path, wu2012):
        def fails(motion, _watch):
            raise OSError(28, "No space left on device", "/tmp/of-an-engine")

        calculation = replace(forces_calculation("fast", wu2012, False), calculate=fails)
        motion = WholeMotion(random_motion(wu2012, 0, 40))
        self.ends(motion, calculation, tmp_path / "f.parquet", OSError, "of-an-engine")

    def test_by_an_output_that_cannot_be_written(self, tmp_path, wu2012):
        calculation = forces_calculation("fast", wu2012, False)
        with pytest.raises(OutputError, match="its folder does not exist"):
            stream(WholeMotion(random_motion(wu2012, 0, 40)), calculation, tmp_path / "no" / "f.csv", silent)


class TestWhatIsStreamed:
    @pytest.fixture
    def path(self, tmp_path, wu2012, monkeypatch):
        monkeypatch.setattr(inputs, "_LONG", 20)
        random_motion(wu2012, 0, 40).save(tmp_path / "long.parquet")
        return tmp_path / "long.parquet"

    @pytest.mark.parametrize("form", ["csv", "parquet"])
    def test_a_long_file_with_derivatives(self, path, wu2012, form):
        Motion.load(path).save(path.with_suffix(f".{form}"))
        assert isinstance(open_motions(str(path.with_suffix(f".{form}")), wu2012), MotionStream)

    def test_no_short_file(self, path, wu2012, monkeypatch):
        monkeypatch.setattr(inputs, "_LONG", 40)
        assert isinstance(open_motions(str(path), wu2012), WholeMotion)

    def test_no_file_without_derivatives(self, tmp_path, path, wu2012):
        poses = put(tmp_path, table(40, **dict.fromkeys((*TWIST, *ACCELERATIONS))), "parquet")
        assert isinstance(open_motions(str(poses), wu2012), WholeMotion)

    def test_no_motion_that_is_fitted_or_bundled(self, path, wu2012):
        assert isinstance(open_motions(str(path), wu2012, fit=True), WholeMotion)
        assert isinstance(open_motions("line", wu2012), WholeMotion)

    def test_options_are_refused_as_for_a_short_file(self, path, wu2012):
        for options in ({"samples": 7}, {"cutoff": 3.0}, {"cutoff": -1.0}):
            for read in (open_motions, load_motion):
                with pytest.raises(MotionError, match=r"--samples: 7; allowed|cutoff: "):
                    read(str(path), wu2012, **options)

    def test_what_does_not_fit_into_memory_is_refused_unread(self, path, wu2012, monkeypatch):
        monkeypatch.setattr(inputs, "_memory", lambda: 39 * 2000)
        with pytest.raises(MotionError) as caught:
            load_motion(str(path), wu2012)
        message = str(caught.value)
        assert message.startswith(
            f"{path}: rows: 40; allowed: at most 39 at once, 2 kB of this machine's memory"
        )
        assert message.isprintable()
        assert isinstance(open_motions(str(path), wu2012), MotionStream)

    def test_this_machine_has_some_memory(self):
        assert inputs._memory() > 2**28
