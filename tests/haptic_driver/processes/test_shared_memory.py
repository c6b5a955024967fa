"""Readers of the shared memory see whole records, are told what they missed, and never wait."""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes import shared_memory
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import (
    NO_ORDER,
    NOTHING_SENSED,
    RING_SAMPLES,
    Sensed,
    SharedState,
)
from haptic_driver.render.texture import FrictionMap, Placed, Uniform
from tests.haptic_driver.daemon.ticks import made_tick

HAMMER_S = 1.0
HAMMER = """
import sys, time
from haptic_driver.processes.shared_memory import Sensed, SharedState
shared = SharedState(int(sys.argv[1]))
print("ready", flush=True)
until_s, k = time.monotonic() + float(sys.argv[2]), 0
while time.monotonic() < until_s:
    for _ in range(100):
        k += 1
        x = float(k)
        shared.sensed.write(Sensed(x, x, x, True, x, x, x, bool(k % 2), *(x,) * 3, True, *(x,) * 9))
        shared.ring.write((k, *(x,) * 11, 1, *(x,) * 2, 1, *(x,) * 18, 1, k % 512))
"""


@pytest.mark.process
def test_what_is_read_while_another_process_writes_is_whole_and_all_accounted_for(shared):
    words = [sys.executable, "-c", HAMMER, str(shared.descriptor), str(HAMMER_S)]
    seen, parts, position, lost, ended = [], [], 0, 0, False
    with subprocess.Popen(words, pass_fds=[shared.descriptor], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        while not ended:
            ended = process.poll() is not None
            seen += [shared.sensed.read() for _ in range(100)]
            taken = shared.ring.read(position)
            parts.append(taken.samples)
            lost, position = lost + taken.lost, taken.position
    records = [record for record in seen if record != NOTHING_SENSED]
    numbers = [record.finger_time_s for record in records]
    assert len(set(numbers)) > 10  # reads met writes; a busy machine gives the reader few turns
    assert numbers == sorted(numbers)
    for record, k in zip(records, numbers, strict=True):
        assert record == Sensed(k, k, k, True, k, k, k, k % 2 == 1, *(k,) * 3, True, *(k,) * 9)
    samples = np.concatenate(parts)
    assert np.all(np.diff(samples["tick"].astype(np.int64)) >= 1)
    np.testing.assert_array_equal(samples["tick"].astype(float), samples["voltage_v"])
    np.testing.assert_array_equal(samples["tick"] % 512, samples["flags"])
    assert len(samples) + lost == shared.ring.position


SHEETS = """
import sys, time
import numpy as np
from haptic_driver.processes.shared_memory import SharedState
shared = SharedState(int(sys.argv[1]))
print("ready", flush=True)
until_s, k = time.monotonic() + float(sys.argv[2]), 0
while time.monotonic() < until_s:
    k += 1
    shared.scene.write(k, (np.full((k % 300, 17), float(k)), np.full((k % 7, 2), float(k))))
"""


@pytest.mark.process
def test_no_tick_ever_sees_a_half_drawn_scene_while_another_process_changes_it(shared):
    words = [sys.executable, "-c", SHEETS, str(shared.descriptor), str(HAMMER_S)]
    seen = []
    with subprocess.Popen(words, pass_fds=[shared.descriptor], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        while process.poll() is None:
            number, tables = shared.scene.read()
            if tables:
                rows, corners = tables
                assert (rows.shape, corners.shape) == ((number % 300, 17), (number % 7, 2))
                assert (rows == number).all()
                assert (corners == number).all()
                seen.append(number)
    assert seen == sorted(seen)
    assert len(set(seen)) > 10  # it did read while the other wrote


@given(st.integers(0, 2000), st.integers(1, 255))
@settings(max_examples=50, deadline=None)
def test_a_table_with_one_wrong_byte_is_not_believed(at, other):
    shared = SharedState()
    tables = np.ones((10, 17)), np.ones((5, 2))
    shared.scene.write(1, tables)
    assert shared.scene.read()[0] == 1
    shared.scene.write(2, tables)
    sheet = shared.scene._memory
    place = 16 + at % 1464  # the number, the sizes and all cells
    sheet[place] ^= other
    assert shared.scene.read()[0] == 1
    shared.close()


def test_a_table_that_does_not_fit_is_refused(shared):
    with pytest.raises(BadInputError, match="too many corners") as refused:
        shared.scene.write(1, (np.ones((500, 17)), np.ones((5000, 2))))
    assert refused.value.code == "scene_too_large"


def test_memory_of_another_version_is_refused():
    descriptor = os.memfd_create("small")
    with pytest.raises(HapticError) as refused:
        SharedState(descriptor)
    os.close(descriptor)
    assert refused.value.code == "bad_memory"


def test_a_writer_killed_in_the_middle_leaves_the_record_before(shared):
    reader = SharedState(shared.descriptor).order
    shared.order.write(NO_ORDER._replace(number=1))
    assert reader.read().number == 1
    memory = shared.order._memory
    memory[0] |= 1  # the sequence number of a write under way
    memory[20] ^= 0xFF
    assert reader.read().number == 1
    shared.order.write(NO_ORDER._replace(number=2))
    assert reader.read().number == 2


def test_a_record_that_does_not_match_its_checksum_is_not_believed(shared):
    reader = SharedState(shared.descriptor).order
    shared.order.write(NO_ORDER._replace(number=1))
    assert reader.read().number == 1
    shared.order.write(NO_ORDER._replace(number=2))
    shared.order._memory[24] ^= 1
    assert reader.read().number == 1


def test_the_ring_keeps_order_over_its_end_and_says_what_a_late_reader_lost(shared):
    for number in range(RING_SAMPLES - 10):
        shared.ring.write(made_tick(number))
    position = shared.ring.read(0).position
    for number in range(RING_SAMPLES - 10, RING_SAMPLES + 20):
        shared.ring.write(made_tick(number))
    taken = shared.ring.read(position)
    assert taken.samples["tick"].tolist() == list(range(RING_SAMPLES - 10, RING_SAMPLES + 20))
    assert taken.lost == 0
    late = shared.ring.read(0)
    assert len(late.samples) + late.lost == RING_SAMPLES + 20
    assert late.lost == 21  # twenty overwritten, and the place that the next one will take
    assert late.samples["tick"][-1] == RING_SAMPLES + 19


def test_a_sample_comes_out_as_it_went_in(shared):
    values = tuple(
        float(i) if SAMPLE[name].kind == "f" else i for i, name in enumerate(SAMPLE.names)
    )
    shared.ring.write(values)
    assert shared.ring.read(0).samples[0].item() == values


def test_a_target_is_taken_over_with_its_map_where_it_lies(shared):
    rng = np.random.default_rng(1)
    cof = 0.5 + 0.2 * rng.random((300, 500))
    given = Placed(FrictionMap(cof, 1e-4, 2e-4), 0.01, 0.02, 0.3)
    shared.targets.write(1, given)
    shared.targets.write(2, Uniform(0.6))
    found = SharedState(shared.descriptor).targets.read(1)
    x, y = rng.random((2, 50)) * 0.05
    np.testing.assert_array_equal(found.cof_at(x, y), given.cof_at(x, y))
    assert not found.texture.cof.flags.owndata
    assert shared.targets.read(2) == Uniform(0.6)


def test_a_target_that_does_not_fit_is_refused(shared, monkeypatch):
    monkeypatch.setattr(shared_memory, "TARGET_BYTES", 100_000)
    with pytest.raises(BadInputError, match=r"the most is 0\.1 MB") as refused:
        shared.targets.write(1, FrictionMap(np.full((200, 200), 0.5), 1e-3, 1e-3))
    assert refused.value.code == "texture_too_large"


def test_the_memory_has_no_name_and_is_not_inherited(shared):
    assert not os.get_inheritable(shared.descriptor)
    # Claims of instruments have names there, and nothing else of ours.
    ours = [name for name in os.listdir("/dev/shm") if name.startswith("haptic")]
    assert all(name.startswith("haptic-driver-") for name in ours)
    assert os.readlink(f"/proc/self/fd/{shared.descriptor}").startswith("/memfd:")
