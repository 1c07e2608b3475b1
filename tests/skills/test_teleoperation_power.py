"""What the coupling tells a passive device of the object's power: as much as the handle renders, at the handle's speed."""

from __future__ import annotations

import pytest

from comanip.loop import run
from comanip.skills.teleoperation import Teleoperation
from haptics import FreeHand, Scripted


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("gain", [0.1, 0.2])
def test_power_is_force_beyond_rest_times_speed_at_the_handles_scale(scale, gain):
    """(K_f / s_v)(F_s - F_s at rest) v: with v = s_v v_h it is K_f (F_s - rest) v_h, whatever s_v is."""
    device, told = Scripted(lambda t: 0.1 if t > 0.2 else 0.0), []
    rendered = device.write
    device.write = lambda force, duration, power=0.0: (told.append(power), rendered(force, duration, power))
    weight = FreeHand(force=lambda t, x: -9.0 - (4.0 if t > 0.6 else 0.0))
    run(weight, Teleoperation(device, n_axes=1, dt=weight.dt, velocity_scale=scale, force_gain=gain), duration_s=1.0)
    assert told[500] == pytest.approx(0.0, abs=1e-9)  # the weight at rest is nobody's work
    assert told[-1] == pytest.approx(gain * -4.0 * 0.1, rel=1e-3)
