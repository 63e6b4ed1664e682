"""A narrow peak of friction, passed at each turn of a fast oscillation, is not jumped over.

mu_inf = 0 and stretched springs: the object slips at up to 3 m/s, and friction acts only within some v_f = 1 cm/s of each turn. X(10 s) is
that of runs with step_max = 1e-5 s (radau9, rtol 1e-13), which no step can hide anything from.
"""

import dynstiction as ds
import pytest
from fig3 import slider

TRUE = {0.05: 0.03726056964321908, 0.1: 0.06443316435171872}
RTOL = (1e-5, 1e-6, 1e-8)


def scene(stretch, method, rtol):
    return ds.Scene(
        scene={"model": "low_frequency", "t_end": 10.0},
        **slider({"system": {"stiffness_y": None}, "friction": {"mu_inf": 0.0}}),
        initial={"velocity_ratio": 0.0, "elongation_x": stretch},
        integrator={"method": method, "rtol": rtol},
        output={"interval": 1.0},
    )


@pytest.mark.parametrize("method", ["radau5", "radau9", "radau13", "dopri5", "dop853"])
@pytest.mark.parametrize("stretch", TRUE)
@pytest.mark.parametrize("rtol", RTOL)
def test_position_after_many_turns(stretch, method, rtol):
    run = ds.run(scene(stretch, method, rtol))
    allowed = (60 if method == "radau5" else 30) * rtol
    assert run["X"][-1] == pytest.approx(TRUE[stretch], rel=allowed)
