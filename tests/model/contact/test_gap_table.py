from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.contact import gap_table as module
from model.contact import resolution
from model.contact.gap_distribution import gap_distribution
from model.contact.gap_integrals import k_hat, l_hat
from model.contact.gap_table import GapTable, gap_mass, gap_table, integrals_of
from model.contact.roughness import SelfAffineShape

FINGERS = ("reference", "table1")
SHAPE = SelfAffineShape(0.8, 1e4, 0.45)
NODES = (85, 121, 15, 3)
GAPS = module.gap_nodes().size


def look_up(table: GapTable, p_hat: float, z_hat: complex) -> tuple[float, complex]:
    return k_hat(table.arrays, p_hat, complex(z_hat)), l_hat(table.arrays, p_hat, complex(z_hat))


def direct(shape: SelfAffineShape, p_hat: float, z_hat: complex) -> tuple[float, complex]:
    k, l = integrals_of(gap_mass(shape, p_hat, 0.05), np.array([z_hat], dtype=complex))  # noqa: E741
    return float(k[0]), complex(l[0])


@pytest.mark.parametrize("name", FINGERS)
def test_gap_integrals_against_reference(models, scales_of, reference, name):
    table, scales = models[name].table, scales_of(models[name])
    r = reference[name]["gap_integrals"]
    k = [
        look_up(table, p / scales.pressure_pa, h / scales.length_m)[0] / scales.length_m**2
        for p, h in zip(r["pressure_pa"], r["h_m"], strict=True)
    ]
    np.testing.assert_allclose(k, r["inverse_square_gap_per_m2"], rtol=2e-3)  # reference: 0.05 %


@pytest.mark.parametrize("name", FINGERS)
@given(
    log_p=st.floats(np.log(1e-6), np.log(4.0)),
    log_z=st.floats(np.log(1e-7), np.log(1e3)),
    angle=st.floats(-np.pi / 2.0, np.pi / 2.0),
)
@settings(max_examples=40)
def test_table_against_direct_quadrature(models, name, log_p, log_z, angle):
    table = models[name].table
    p_hat, z_hat = np.exp(log_p), np.exp(log_z + 1j * angle)
    k, l = direct(table.shape, p_hat, z_hat)  # noqa: E741
    table_k, table_l = look_up(table, p_hat, z_hat)
    assert table_k == pytest.approx(k, rel=1e-4)  # what the surface is promised
    assert abs(table_l - l) <= 1e-4 * abs(l)


@pytest.mark.parametrize("name", FINGERS)
@pytest.mark.parametrize("p_hat", [4.5, 6.3, 8.1, 9.7])
def test_table_where_the_contact_is_nearly_complete(models, name, p_hat):
    """More than 1 MPa: the area out of contact vanishes like an error function, which four nodes
    follow less well.
    """
    table = models[name].table
    for z_hat in (1e-4, 0.3 * np.exp(0.9j), 50.0):
        k, l = direct(table.shape, p_hat, z_hat)  # noqa: E741
        table_k, table_l = look_up(table, p_hat, z_hat)
        assert table_k == pytest.approx(
            k, rel=1e-3
        )  # 4e-4 at most, in the last cells; the reference asks 2e-3
        assert abs(table_l - l) <= 1e-3 * abs(l)


@pytest.mark.parametrize("z_hat", [1e-8, 3e-9 * np.exp(1.0j), 3e3, 1e4 * np.exp(-0.7j), 1e5])
def test_beyond_the_lengths_of_the_table_its_limits_hold(models, z_hat):
    table = models["reference"].table
    k, l = direct(table.shape, 0.02, z_hat)  # noqa: E741
    table_k, table_l = look_up(table, 0.02, z_hat)
    # past the edge at 1e3, K z^2 still moves by 2<u>/z = 4e-3; below the edge at 1e-7, P is not yet
    # quite constant and K |z| rises by 2.3 %
    assert table_k == pytest.approx(k, rel=5e-3 if abs(z_hat) > 1.0 else 3e-2)
    if abs(z_hat) > 1.0:
        assert abs(table_l - l) <= 5e-3 * abs(l)  # L moves half as much


def test_beyond_its_pressures_the_table_holds_its_ends(models):
    for outside, end in ((0.9e-6, 1e-6), (11.0, 10.0)):
        for found, expected in zip(
            look_up(models["reference"].table, outside, 1.0),
            look_up(models["reference"].table, end, 1.0),
            strict=True,
        ):
            assert found == pytest.approx(expected, rel=1e-12)  # rounding of the end's logarithm


def test_grid_of_gaps_has_converged(monkeypatch):
    z = np.array([1e-6, 1e-3 * np.exp(0.5j), 1.0j, 30.0])
    k, l = integrals_of(gap_mass(SHAPE, 0.02), z)  # noqa: E741
    low, high, step = module.LOG_U_AXIS
    monkeypatch.setattr(module, "LOG_U_AXIS", (low, high, 0.31 * step))
    finer_k, finer_l = integrals_of(gap_mass(SHAPE, 0.02), z)
    np.testing.assert_allclose(k, finer_k, rtol=1e-6)  # the same trapezoid rule on other nodes
    np.testing.assert_allclose(l, finer_l, rtol=1e-6)


def test_wide_gaps_are_a_plate_capacitor(models, scales_of):
    """A stack far thicker than the roughness sees the mean gap only: K -> 1/z^2."""
    shape = models["reference"].table.shape
    p_hat = 5e3 / scales_of(models["reference"]).pressure_pa
    k, _ = direct(shape, p_hat, 1e3)  # in h_rms
    gap = gap_distribution(shape, p_hat)
    expected = (1.0 - gap.area_ratio) / (1e3 + gap.mean_gap) ** 2
    # mass 2e-4, mean 1 % of 2e-3, spread (1/1e3)^2
    assert k == pytest.approx(expected, rel=3e-4)


def save(path: Path, **changes: np.ndarray) -> None:
    np.savez(
        path, **{"values": np.full(NODES, 0.25), "mass": np.full((NODES[0], GAPS), 0.5), **changes}
    )


class TestCache:
    """`build_table` is replaced by constants: what counts here is where numbers are kept."""

    @pytest.fixture
    def builds(self, monkeypatch):
        calls: list[SelfAffineShape] = []

        def build(shape: SelfAffineShape) -> GapTable:
            calls.append(shape)
            return GapTable(shape, np.full(NODES, 0.25), np.full((NODES[0], GAPS), 0.5))

        monkeypatch.setattr(module, "build_table", build)
        return calls

    def load(self, folder) -> GapTable:
        return gap_table.__wrapped__(SHAPE, folder)  # past the memory of this process

    def test_second_load_reads_what_the_first_wrote(self, tmp_path, builds):
        first, second = (
            self.load(tmp_path / "new" / "folder"),
            self.load(tmp_path / "new" / "folder"),
        )
        assert len(builds) == 1
        np.testing.assert_array_equal(second.values, first.values)
        np.testing.assert_array_equal(second.mass, first.mass)
        assert second.content_hash == first.content_hash

    @pytest.mark.parametrize(
        "damage",
        [
            lambda path: path.write_bytes(path.read_bytes()[:-100]),
            lambda path: save(path, values=np.zeros((3, 3))),
            lambda path: save(path, values=np.array([{"a": 1}], dtype=object)),
            lambda path: save(path, mass=np.full((NODES[0], GAPS), np.inf)),
            lambda path: np.savez(path, values=np.full(NODES, 0.25)),
            lambda path: save(path, values=np.full(NODES, 0.125)),
        ],
    )
    def test_a_damaged_or_foreign_file_is_built_again(self, tmp_path, builds, damage):
        path = tmp_path / f"gap-table-{self.load(tmp_path).content_hash}.npz"
        damage(path)
        table = self.load(tmp_path)
        np.testing.assert_array_equal(table.values, np.full(NODES, 0.25))
        np.testing.assert_array_equal(table.mass, np.full((NODES[0], GAPS), 0.5))
        assert len(builds) == 2
        with np.load(path) as mended:  # on disk too
            np.testing.assert_array_equal(mended["values"], np.full(NODES, 0.25))
            np.testing.assert_array_equal(mended["mass"], np.full((NODES[0], GAPS), 0.5))

    def test_a_cache_that_cannot_be_written_is_done_without(self, tmp_path, builds):
        in_the_way = tmp_path / "file"
        in_the_way.write_text("a file where the folder should be")
        assert self.load(in_the_way).values.shape == NODES

    def test_a_failed_write_leaves_the_old_file_and_no_part(self, tmp_path, monkeypatch):
        def full_disk(file, **arrays) -> None:
            file.write(b"half")
            raise OSError(28, "No space left on device")

        old = tmp_path / "table.npz"
        old.write_bytes(b"old")
        monkeypatch.setattr(module.np, "savez", full_disk)
        module._write(old, GapTable(SHAPE, np.zeros(3), np.zeros(3)))
        assert old.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [old]

    def test_each_shape_and_each_grid_has_its_own_file(self, monkeypatch):
        shapes = [
            SHAPE,
            SelfAffineShape(0.81, 1e4, 0.45),
            SelfAffineShape(0.8, 2e4, 0.45),
            SelfAffineShape(0.8, 1e4, 0.5),
        ]
        hashes = [GapTable(s, np.zeros(NODES), np.zeros(3)).content_hash for s in shapes]
        assert (
            GapTable(SelfAffineShape(0.8, 1e4, 0.45), np.ones(1), np.ones(1)).content_hash
            == hashes[0]
        )
        for rule in (name for name in vars(resolution) if name.isupper()):
            with monkeypatch.context() as patch:
                patch.setattr(resolution, rule, -1)
                hashes.append(GapTable(SHAPE, np.zeros(NODES), np.zeros(3)).content_hash)
        assert len(hashes) == len(shapes) + 10
        assert len(set(hashes)) == len(hashes)

    def test_environment_names_the_folder(self, tmp_path, builds, monkeypatch):
        monkeypatch.setenv("HAPTIC_CACHE_DIR", str(tmp_path / "own"))
        table = gap_table.__wrapped__(SHAPE)
        assert (tmp_path / "own" / f"gap-table-{table.content_hash}.npz").is_file()


@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
def test_a_smooth_shape_has_a_finite_table():
    table = module.build_table(SelfAffineShape(0.8, 2.0, 0.45))
    assert np.isfinite(table.values).all()
    assert np.isfinite(table.mass).all()
