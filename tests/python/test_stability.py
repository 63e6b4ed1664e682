"""Linear theory of steady sliding: the executable's table and the functions of the package."""

from __future__ import annotations

import re

import numpy as np
import pytest
from fig3 import SLIDER as FIG3
from programs import INPUTS

DEGREE = np.pi / 180
CONSTANT = {**FIG3, "mu_inf": None, "v_f": None}
NO_FALL = ("friction.law=constant", "friction.mu_inf=", "friction.v_f=")


# The executable


@pytest.fixture
def stability(program, fig3_text, tmp_path):
    """Call `dynstiction stability` on the deck of Fig. 3, with --set for each argument."""
    (tmp_path / "fig3.nml").write_text(fig3_text)
    return lambda *settings, deck="fig3.nml": program("stability", deck, settings=settings)


def value(table: str, label: str) -> float:
    """The first number after a label at the beginning of a line."""
    found = re.search(rf"^{re.escape(label)} +(-?[0-9.]+(?:e-?[0-9]+)?)\b", table, re.MULTILINE)
    assert found, f"no {label!r} in\n{table}"
    return float(found[1])


@pytest.mark.deck
def test_table_of_fig3(stability):
    result = stability()
    assert (result.returncode, result.stderr) == (0, "")
    table = result.stdout
    assert value(table, "critical angle, slow mode") == pytest.approx(8.65603, abs=5e-6)
    assert value(table, "critical angle, rigid stiff axis") == pytest.approx(8.65536, abs=5e-6)
    assert value(table, "critical angle, fast mode") == pytest.approx(76.3, abs=0.05)
    assert re.search(r"8\.656033\d* deg, at 64\.39\d+ rad/s = 10\.248\d+ Hz", table)
    assert re.search(r"^stable for +8\.656033\d* deg < \|phi\| < 76\.26\d+ deg$", table, re.MULTILINE)
    assert value(table, "Lambda") == pytest.approx(3623.9, abs=0.05)
    assert value(table, "zeta at theta = phi") == pytest.approx(0.01926, abs=5e-6)
    assert value(table, "theta*") == pytest.approx(3.733, abs=5e-4)
    assert table.splitlines()[1] == "stick-slip (the load swings by 0.824 N, 41 % of mu_0 W); steady sliding is not stable"
    rows = re.findall(r"^ +[1-4]((?: +[-+.e0-9]+){4})$", table, re.MULTILINE)
    assert len(rows) == 4
    growth, rate, frequency, damping = np.array([row.split() for row in rows], dtype=float).T
    assert np.all(np.diff(growth) <= 0)
    np.testing.assert_allclose(frequency, abs(rate) / (2 * np.pi), rtol=1e-8)
    np.testing.assert_allclose(damping, -growth / np.hypot(growth, rate), rtol=1e-6)


@pytest.mark.deck
@pytest.mark.parametrize(
    ("is_stable", "angle", "settings"),
    [
        *((is_stable, angle, []) for angle, is_stable in ((8.6560, 0), (8.6561, 1), (76.26, 1), (76.27, 0), (-10, 1), (170, 1))),
        *((is_stable, angle, NO_FALL) for angle, is_stable in ((1, 1), (0, 0), (90, 0))),
        (1, 0, ["friction.mu_inf=0.3"]),
        (0, 20, ["system.stiffness_y=1e3"]),
        (0, 20, [*NO_FALL, "friction.mu_0=0"]),
        # |F'| > F/V: the sum of the eigenvalues is positive.
        (0, 20, ["friction.mu_0=0.5", "friction.mu_inf=0", "friction.v_f=1e-3", "drive.velocity=2e-3"]),
    ],
)
def test_table_gives_the_verdict(is_stable, angle, settings, stability):
    """Constant friction is stable except along an axis, strengthening friction along one too; equal stiffnesses, no friction and
    steep weakening are not.
    """
    table = stability(f"system.misalignment_deg={angle}", *settings).stdout
    assert re.search(rf"; steady sliding is {'' if is_stable else 'not '}stable$", table, re.MULTILINE)


@pytest.mark.deck
@pytest.mark.parametrize(
    ("settings", "line"),
    [
        (NO_FALL, r"critical angle +none between 0 and 90 deg"),
        (NO_FALL, r"stable for +0 deg < \|phi\| < 90 deg"),
        (("system.stiffness_y=3.9e5",), r"stable for +no angle"),
        (("system.misalignment_deg=0",), r"Lambda, zeta, theta\* +no value: V sin\(phi\) = 0.*"),
        (("friction.normal_load=1e-3",), r"theta\* +no value: Lambda = 0\.36\d+: .*Lambda >= 1.*"),
    ],
)
def test_what_has_no_value_is_said(settings, line, stability):
    table = stability(*settings)
    assert table.returncode == 0 and re.search(f"^{line}$", table.stdout, re.MULTILINE)


@pytest.mark.deck
def test_each_held_velocity_has_a_table(stability):
    profile = ["drive.time=0,1,1,2,3,4", "drive.velocity=1e-3,1e-3,0,0,-1e-3,5e-3"]
    table = stability(*profile).stdout
    assert re.findall(r": at V = (\S+) m/s", table) == ["0.001", "0.005"]
    assert table.startswith(stability().stdout)


@pytest.mark.deck
def test_refusals(stability):
    for settings in (["drive.velocity=0"], ["drive.time=0,1,2", "drive.velocity=0,1e-3,0"]):
        rest = stability(*settings)
        assert (rest.returncode, rest.stdout) == (2, "")
        assert "the drive holds no velocity but 0" in rest.stderr


@pytest.mark.deck
def test_all_inputs_have_a_table(program):
    models = ("low_frequency", "creep", "creep_asymptotic")
    without_theory = {**dict(zip(models, models, strict=True)), "map_lambda": "low_frequency"}
    with_theory = [deck for deck in INPUTS.glob("*.nml") if deck.stem not in without_theory]
    assert with_theory
    result = program("stability", *with_theory)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.count("# ") >= len(with_theory)
    for name, model in without_theory.items():
        refused = program("stability", INPUTS / f"{name}.nml", status=2).stderr
        assert f"which model '{model}' does not have: give a deck of model 'full'" in refused


# The package


@pytest.fixture(scope="module")
def ds():
    return pytest.importorskip("dynstiction")


def friction(velocity, *, mu_0, mu_inf, v_f, normal_load, **_):
    """F(V) and F'(V)."""
    drop = (mu_0 - mu_inf) * np.exp(-velocity / v_f) * normal_load
    return mu_inf * normal_load + drop, -drop / v_f


def matrix(parameters):
    """First-order matrix of m u'' + D u' + K u = 0, in plain SI unknowns u, u'."""
    force, slope = friction(**parameters)
    phi, mass = np.radians(parameters["misalignment_deg"]), parameters["mass"]
    along, across = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
    damping = slope * np.outer(along, along) + force / parameters["velocity"] * np.outer(across, across)
    stiffness = np.diag([parameters["stiffness_x"], parameters["stiffness_y"]])
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass, -damping / mass]])


def by_falling_real_part(eigenvalues):
    return eigenvalues[np.lexsort((-eigenvalues.imag, -np.round(eigenvalues.real, 9)))]


def random_parameters(n):
    random = np.random.default_rng(20)

    def spread(low, high):
        return 10 ** random.uniform(np.log10(low), np.log10(high), n)

    return {
        "mass": spread(1e-2, 10),
        "stiffness_x": spread(1e2, 1e4),
        "stiffness_y": spread(1e4, 1e7),
        "misalignment_deg": random.uniform(0.5, 86, n),
        "mu_0": random.uniform(0.2, 1, n),
        "mu_inf": random.uniform(0.05, 0.5, n),
        "v_f": spread(1e-3, 1),
        "normal_load": spread(0.1, 100),
        "velocity": spread(1e-3, 1),
    }


def test_eigenvalues_against_numpy(ds):
    parameters = random_parameters(200)
    found = ds.steady_sliding_eigenvalues(**parameters)
    assert found.shape == (200, 4)
    assert found.dtype == np.complex128
    assert found.flags.c_contiguous
    assert np.all(np.diff(found.real, axis=1) <= 0)
    for i, eigenvalues in enumerate(found):
        expected = np.linalg.eigvals(matrix({name: values[i] for name, values in parameters.items()}))
        # Compared as sets: each has its partner.
        distance = abs(eigenvalues[:, np.newaxis] - expected)
        assert np.max(np.min(distance, axis=1)) < 1e-11 * np.max(abs(expected))
        assert np.max(np.min(distance, axis=0)) < 1e-11 * np.max(abs(expected))


def test_eigenvalues_against_the_jacobian(ds):
    """The derivative of the full model at steady sliding has the same eigenvalues."""
    for smoothing in (0.0, 5e-4):
        phi, velocity = np.radians(FIG3["misalignment_deg"]), FIG3["velocity"]
        state = [0.0, 0.0, velocity * np.cos(phi), velocity * np.sin(phi)]
        jacobian = ds.jacobian(state, **FIG3, v_smooth=smoothing)
        expected = by_falling_real_part(np.linalg.eigvals(jacobian))
        found = ds.steady_sliding_eigenvalues(**FIG3, v_smooth=smoothing)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-8)


def test_critical_angles_of_fig3(ds):
    found = ds.critical_misalignment(**FIG3)
    assert found.angle[0] == pytest.approx(8.65603, abs=5e-6)
    assert found.frequency[0] == pytest.approx(64.39, abs=5e-3)
    assert found.angle[1] == pytest.approx(76.3, abs=0.05)
    assert found.limit == pytest.approx(8.65536, abs=5e-6)
    np.testing.assert_array_equal(found.window, found.angle)
    at_critical = ds.steady_sliding_eigenvalues(**{**FIG3, "misalignment_deg": found.angle})
    np.testing.assert_allclose(at_critical[:, 0].real, 0, atol=1e-9)
    np.testing.assert_allclose(at_critical[:, 0].imag, found.frequency, rtol=1e-12)
    constant = ds.critical_misalignment(**CONSTANT)
    assert np.all(np.isnan(constant.angle)) and np.all(np.isnan(constant.frequency))
    np.testing.assert_array_equal(constant.window, [0, 90])
    assert constant.limit == 0


# The sign changes of the largest real part of eigenvalues computed with 40 digits, bisected (mpmath) [deg].
WINDOWS = {
    4e2: [12.419841572245611, 19.216159069102179],
    5e2: [9.5223349074520279, 33.000471027848673],
    1e3: [8.7555808253331495, 53.080636878362375],
    1e4: [8.6560331384295429, 76.263436095299451],
}


def test_windows(ds):
    found = ds.critical_misalignment(**{**FIG3, "stiffness_y": 1e3 * np.array([*WINDOWS])})
    np.testing.assert_allclose(found.window, [*WINDOWS.values()], rtol=1e-13)
    # With x and y exchanged they are those from the other axis.
    swapped = ds.critical_misalignment(**{**FIG3, "stiffness_x": 1e3 * np.array([*WINDOWS]), "stiffness_y": 1e3})
    np.testing.assert_allclose(swapped.angle, 90 - found.angle, rtol=1e-13)


@pytest.mark.parametrize("stiffness", [1e12, 1e15])
def test_frequency_beside_a_rigid_axis(ds, stiffness):
    """That of the mass on the soft spring, with all digits: the correction is of the order of k_x/k_y."""
    found = ds.critical_misalignment(**{**FIG3, "stiffness_y": stiffness})
    assert found.frequency[0] == pytest.approx(np.sqrt(FIG3["stiffness_x"] / FIG3["mass"]), rel=1e-6)
    assert found.frequency[1] == pytest.approx(np.sqrt(stiffness / FIG3["mass"]), rel=1e-6)


def test_a_window_needs_a_stiff_axis(ds):
    """(sqrt(k_y) - sqrt(k_x))^2 > |F'| F/(V m), that is k_y/k_x > 391.9; the eigenvalues agree."""
    force, slope = friction(**FIG3)
    bound = -slope * force / FIG3["velocity"] / (FIG3["mass"] * FIG3["stiffness_x"])
    edge = (1 + np.sqrt(bound)) ** 2
    assert (bound, edge) == (pytest.approx(353.0, abs=0.5), pytest.approx(391.9, abs=0.05))
    grid = (np.arange(9000) + 0.5) / 100
    for ratio, changes in ((1.0001 * edge, 2), (0.9999 * edge, 0), (353.5, 0)):
        scene = {**FIG3, "stiffness_y": 1e3 * ratio}
        is_stable = ds.steady_sliding_eigenvalues(**{**scene, "misalignment_deg": grid})[:, 0].real < 0
        assert np.count_nonzero(np.diff(is_stable)) == changes
        assert np.isfinite(ds.critical_misalignment(**scene).angle).all() == (changes == 2)


def test_critical_angles_over_the_velocity(ds):
    velocity = np.array([0.1, 0.3, 1, 3, 10, 30, 50, 100]) * 1e-3
    found = ds.critical_misalignment(**{**FIG3, "velocity": [velocity, -velocity]}).angle[..., 0]
    np.testing.assert_allclose(found[0], [2.889, 4.899, 8.656, 13.698, 18.289, 12.479, 6.042, 0.705], rtol=0, atol=5e-4)
    np.testing.assert_array_equal(found[1], found[0])


def test_shapes_broadcast(ds):
    velocity = np.array([1e-3, 2e-3, 3e-3])
    phi = np.array([[6.0], [12.0]])
    parameters = {**FIG3, "velocity": velocity, "misalignment_deg": phi}
    eigenvalues = ds.steady_sliding_eigenvalues(**parameters)
    assert eigenvalues.shape == (2, 3, 4)
    one = ds.steady_sliding_eigenvalues(**{**FIG3, "velocity": 3e-3, "misalignment_deg": 12.0})
    np.testing.assert_array_equal(eigenvalues[1, 2], one)
    assert ds.critical_misalignment(**parameters).limit.shape == (2, 3)
    assert ds.damping_ratio(np.ones((4, 1, 1)), **parameters).shape == (4, 2, 3)
    assert ds.damping_ratio([], **FIG3).shape == (0,)
    assert ds.steady_sliding_eigenvalues(**{**FIG3, "velocity": []}).shape == (0, 4)
    assert ds.critical_misalignment(**{**FIG3, "velocity": []}).angle.shape == (0, 2)
    assert ds.damping_ratio(1.0, **FIG3).shape == ()


def test_damping_ratio(ds):
    assert ds.damping_ratio(np.pi / 2, **CONSTANT) == pytest.approx(3623.9, abs=0.05)
    theta = np.radians([1, 3, 4.316, 5.10, 20, 90, 170])
    plain = ds.damping_ratio(theta, **CONSTANT)
    np.testing.assert_allclose(plain, plain[5] * np.sin(theta) ** 3, rtol=1e-14)
    weakening = ds.damping_ratio(theta, **FIG3)
    speed = 1e-3 * np.sin(DEGREE) / np.sin(theta)
    force, slope = friction(**{**FIG3, "velocity": speed})
    across = force * np.sin(theta) ** 3 / (1e-3 * np.sin(DEGREE))
    expected = (slope * np.cos(theta) ** 2 + across) / (2 * np.sqrt(250))
    np.testing.assert_allclose(weakening, expected, rtol=1e-12)


@pytest.mark.parametrize("angle", [5.0, 8.0, 10.0, 30.0, 77.0])
def test_growth_rate_of_the_full_model(angle, ds, fig3):
    """A run that starts beside steady sliding follows the leading eigenvalue."""
    parameters = {**FIG3, "misalignment_deg": angle}
    force, _ = friction(**parameters)
    along = np.array([np.cos(angle * DEGREE), np.sin(angle * DEGREE)])
    steady = force * along / [1e3, 1e7]
    start = {"velocity_ratio": 1.0, "elongation_x": steady[0] * (1 + 1e-6), "elongation_y": steady[1]}
    result = ds.run(fig3, t_end=0.04, misalignment_deg=angle, rtol=1e-12, method="radau13", interval=1e-4, **start)
    elongation = (result[name] - at for name, at in zip(("u_x", "u_y"), steady, strict=True))
    velocity = (1e-3 * share - result[name] for name, share in zip(("w_x", "w_y"), along, strict=True))
    perturbation = np.stack([*elongation, *velocity])
    values, left = np.linalg.eig(matrix(parameters).T)
    leading = np.argmax(values.real + 1e-9 * values.imag)
    # The left eigenvector picks the leading mode out of the motion.
    amplitude = left[:, leading] @ perturbation
    phase = np.unwrap(np.angle(amplitude))
    after = result.time > 0.004
    growth = np.polyfit(result.time[after], np.log(abs(amplitude[after])), 1)[0]
    rate = np.polyfit(result.time[after], phase[after], 1)[0]
    expected = ds.steady_sliding_eigenvalues(**parameters)[0]
    assert np.max(abs(perturbation[2:])) < 1e-2 * 1e-3
    # What is left is the quadratic part of the equations.
    assert growth == pytest.approx(expected.real, rel=5e-3)
    assert rate == pytest.approx(expected.imag, abs=1e-3 * abs(expected))
