"""MuJoCo on the reference scenes of this folder (docs/howto/simulators.md): pip install mujoco

    python bench/simulators/mujoco_peer.py [SCENE.csv ...] [--dt 1e-5]

For each scene and setting of the contact: X at the end, the largest error of X over its largest value, and processor time.
"""

import argparse
import re
import time
from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).resolve().parent
# cone, impratio, noslip_iterations, solref
SETTINGS = (
    ("pyramidal", 1, 0, 0.02),
    ("elliptic", 1, 0, 0.02),
    ("elliptic", 10, 0, 0.02),
    ("elliptic", 10, 20, 0.02),
    ("elliptic", 100, 0, 0.002),
)
BODY = """<mujoco>
<option timestep="{dt}" integrator="implicitfast" cone="{cone}" impratio="{impratio}" noslip_iterations="{noslip}" iterations="200" tolerance="1e-14"/>
<worldbody>
<geom type="plane" size="1 1 1" friction="{mu_0} 0 0" condim="3" solref="{solref} 1"/>
<body pos="0 0 0.01">
<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="slide" axis="0 0 1"/>
<geom type="sphere" size="0.01" mass="{mass}" friction="{mu_0} 0 0" condim="3" solref="{solref} 1"/>
</body>
</worldbody></mujoco>"""


def read(path):
    """The numbers of a scene, the knots of its drive, and the table."""
    head = path.read_text().splitlines()[0]
    keys = {name: float(value) for name, value in re.findall(r"(\w+) = ([-+.\deE]+)", head)}
    lists = [[float(x) for x in found.split(",")] for found in re.findall(r"\[(.*?)\]", head)]
    table = np.loadtxt(path, delimiter=",", skiprows=3)
    knots = lists or [[0.0, table[-1, 0]], [keys["velocity"]] * 2]
    return keys, knots, table


def advance(keys, knots, table, dt, cone, impratio, noslip, solref):
    """X of the body at the times of the table."""
    model = mujoco.MjModel.from_xml_string(
        BODY.format(**keys, dt=dt, cone=cone, impratio=impratio, noslip=noslip, solref=solref)
    )
    data = mujoco.MjData(model)
    phi = np.radians(keys["misalignment_deg"])
    axes = np.array([[np.cos(phi), np.sin(phi)], [-np.sin(phi), np.cos(phi)]])
    stiffness = axes.T @ np.diag([keys["stiffness_x"], keys["stiffness_y"]]) @ axes
    steps = round(table[-1, 0] / dt)
    # A step of the velocity is a knot twice: the later value holds from there on.
    starts = np.array(knots[0]) + 1e-12 * np.arange(len(knots[0]))
    velocity = np.interp(dt * (np.arange(steps) + 0.5), starts, knots[1])
    drive = np.concatenate([[0.0], np.cumsum(velocity) * dt])
    normal = keys["mass"] * -model.opt.gravity[2] - keys["normal_load"]
    found = np.empty(steps + 1)
    for i in range(steps + 1):
        found[i] = data.qpos[0]
        data.qfrc_applied[:2] = stiffness @ (np.array([drive[i], 0.0]) - data.qpos[:2])
        data.qfrc_applied[2] = normal
        mujoco.mj_step(model, data)
    return np.interp(table[:, 0], dt * np.arange(steps + 1), found)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", nargs="*", type=Path, default=sorted(HERE.glob("*.csv")))
    parser.add_argument("--dt", type=float, default=1e-5)
    options = parser.parse_args()
    print(
        "| scene | exact X [µm] | cone | impratio | noslip | solref | X [µm] | largest error of X | s |\n|"
        + " --- |" * 9
    )
    for path in options.scenes:
        keys, knots, table = read(path)
        for setting in SETTINGS:
            begin = time.process_time()
            x = advance(keys, knots, table, options.dt, *setting)
            error = np.abs(x - table[:, 1]).max() / np.abs(table[:, 1]).max()
            print(
                f"| {path.stem} | {1e6 * table[-1, 1]:.6g} | {' | '.join(map(str, setting))} | {1e6 * x[-1]:.6g} | {error:.2g} | {time.process_time() - begin:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
