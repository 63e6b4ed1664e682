"""Work against true error of methods on random scenes, step by step, for readers to repeat.

    python bench/work_precision.py [--methods NAME...] [--scenes N] [--seed N] [--exe PATH] [--short]

Runs Fig. 3 (10 s) and N random scenes (mass, stiffness_y, misalignment, drive velocity and v_f log-uniform) at rtol 1e-2 ... 1e-5
with the cycle map off. Prints the error of w and u_x relative to radau13 at rtol 1e-11 (root mean square of 200 samples), the
difference in the number of sticks, and the millions of instructions (callgrind) minus those of a run of length 0; 0 without
valgrind. Errors near 1 belong to scenes in which disturbances grow. All of it takes about an hour.
"""

import argparse
import math
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import h5py
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DECK = ROOT / "inputs" / "fig3.nml"
VALGRIND = shutil.which("valgrind")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
SAMPLES = 200
#: Fast cycles and times to load the soft spring after which a random scene ends, whichever is first.
FAST_CYCLES, LOADS = 150, 2
#: Values of Fig. 3, which the random scenes share: N/m and N.
STIFFNESS_X, STATIC_LIMIT = 1e3, 2.0

Scene = dict[str, float]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--methods", nargs="+", default=["radau5", "radau9", "radau13"])
    parser.add_argument("--scenes", type=int, default=12, help="random ones")
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--exe", default=shutil.which("dynstiction") or ROOT / ".venv/bin/dynstiction")
    parser.add_argument(
        "--short", action="store_true", help="a short form of some seconds, to check that it runs"
    )
    options = parser.parse_args()
    scenes = [{"scene.t_end": 10.0}, *random_scenes(options.scenes, options.seed)]
    tolerances: tuple[float, ...] = TOLERANCES
    if options.short:
        scenes, tolerances = [{"scene.t_end": 0.05}], TOLERANCES[2:3]
    with tempfile.TemporaryDirectory() as folder:
        for scene in scenes:
            table(str(options.exe), Path(folder) / "run.h5", scene, options.methods, tolerances)


def random_scenes(number: int, seed: int) -> list[Scene]:
    """Scenes of a few hundred fast cycles or two slow ones, whichever is less."""
    random = np.random.default_rng(seed)

    def draw(low: float, high: float) -> float:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))

    scenes = []
    for _ in range(number):
        mass, stiffness_y, angle = draw(1e-4, 10), draw(1e5, 1e10), draw(0.05, 30)
        velocity, v_f = draw(1e-5, 0.1), draw(1e-4, 1)
        fast = 2 * math.pi * math.sqrt(mass / stiffness_y)
        fast += STATIC_LIMIT / (stiffness_y * velocity * math.sin(math.radians(angle)))
        slow = STATIC_LIMIT / STIFFNESS_X / velocity + 2 * math.pi * math.sqrt(mass / STIFFNESS_X)
        scenes.append(
            {
                "system.mass": mass,
                "system.stiffness_y": stiffness_y,
                "system.misalignment_deg": angle,
                "drive.velocity": velocity,
                "friction.v_f": v_f,
                "scene.t_end": min(FAST_CYCLES * fast, LOADS * slow),
            }
        )
    return scenes


def table(exe: str, file: Path, scene: Scene, methods: list[str], tolerances: tuple[float, ...]) -> None:
    """Errors and work of one scene."""
    w, u, sticks = result(exe, file, scene, "radau13", 1e-11)
    print(
        "\n" + " ".join(f"{key.split('.')[1]}={value:.3g}" for key, value in scene.items()), "sticks", sticks
    )
    nothing = instructions(exe, file, scene | {"scene.t_end": 1e-12}, methods[0], 1e-4)
    print(f"{'method':8} {'rtol':>6} {'w':>8} {'u_x':>8} {'sticks':>6} {'instructions [M]':>16}")
    for method in methods:
        for rtol in tolerances:
            its_w, its_u, its_sticks = result(exe, file, scene, method, rtol)
            work = instructions(exe, file, scene, method, rtol) - nothing
            errors = [difference(its_w, w), difference(its_u, u)]
            print(
                f"{method:8} {rtol:6.0e} {errors[0]:8.1e} {errors[1]:8.1e} {its_sticks - sticks:6d} {work / 1e6:16.1f}",
                flush=True,
            )


def difference(values: np.ndarray, reference: np.ndarray) -> float:
    scale = np.sqrt(np.mean(reference**2))
    return float(np.sqrt(np.mean((values - reference) ** 2)) / scale) if scale > 0 else 0.0


def command(exe: str, file: Path, scene: Scene, method: str, rtol: float) -> list[str]:
    settings = scene | {"output.interval": scene["scene.t_end"] / SAMPLES, "integrator.rtol": rtol}
    words = [exe, "run", str(DECK), "-o", str(file), "--overwrite", "--quiet"]
    for key, value in settings.items():
        words += ["--set", f"{key}={value!r}"]
    return [*words, "--set", f"integrator.method={method}", "--set", "integrator.cycle_map=off"]


def result(
    exe: str, file: Path, scene: Scene, method: str, rtol: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Samples of w and u_x, and the number of sticks."""
    subprocess.run(command(exe, file, scene, method, rtol), check=True)
    with h5py.File(file) as run:
        series = run["time_series"]
        return np.array([series["w_x"], series["w_y"]]), series["u_x"][:], int(run["summary/sticks"][()])


def instructions(exe: str, file: Path, scene: Scene, method: str, rtol: float) -> int:
    """Instructions of the whole process: the largest of the counts that it and its child processes print."""
    if VALGRIND is None:
        return 0
    # The check of a file before it is replaced also takes instructions.
    file.unlink()
    words = [VALGRIND, "--tool=callgrind", f"--callgrind-out-file={file}.callgrind"]
    words += command(exe, file, scene, method, rtol)
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    return max(int(count) for count in re.findall(r"Collected : (\d+)", done.stderr))


if __name__ == "__main__":
    main()
