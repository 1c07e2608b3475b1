"""Recordings of a vertical lift made from a formula, and ways to spoil them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from comanip.recording import Channel, Recording

CHANNEL = {"position": "hand.position", "velocity": "hand.velocity", "force": "hand.force"}


def minimum_jerk(time, start=1.0, duration=2.0, height=0.25):
    """Position, velocity and acceleration of a lift that begins at `start` [s]."""
    s = np.clip((time - start) / duration, 0.0, 1.0)
    x = height * (10 * s**3 - 15 * s**4 + 6 * s**5)
    dx = height / duration * (30 * s**2 - 60 * s**3 + 30 * s**4)
    ddx = height / duration**2 * (60 * s - 180 * s**2 + 120 * s**3)
    return x, dx, ddx


def lift(seed=0, rate_hz=100.0, role="follower", noise=1.0, duration_s=4.0, **metadata):
    """1 s of rest, 0.25 m up in 2 s, rest again; the partner pulls with 25 N s/m along the motion."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    x, dx, _ = minimum_jerk(time)
    channels = {
        "hand.position": Channel(time, 0.8 + x + noise * 2e-5 * rng.normal(size=len(time)), "m", "task", ("z",)),
        "hand.velocity": Channel(time, dx + noise * 1e-3 * rng.normal(size=len(time)), "m/s", "task", ("z",)),
        "hand.force": Channel(time, 25.0 * dx + noise * 0.1 * rng.normal(size=len(time)), "N", "task", ("z",)),
    }
    return Recording(channels, {"name": f"lift{seed}", "role": role, **metadata})


def corrupt(recording, kind, channel, frame=0, amount=1.0):
    """One fault in one channel: "nan", "inf", "scale", "offset", "swap", "repeat", "cut", "shift", "drop"."""
    name = CHANNEL.get(channel, channel)
    signal = recording[name]
    time, values = np.array(signal.time), np.array(signal.values)
    if kind in ("nan", "inf"):
        values[frame] = np.nan if kind == "nan" else np.inf
    elif kind == "scale":
        values *= amount
    elif kind == "offset":
        values += amount
    elif kind == "swap":
        time[[frame, frame + 1]] = time[[frame + 1, frame]]
    elif kind == "repeat":
        time, values = (np.insert(a, frame, a[frame], axis=0) for a in (time, values))
        values[frame + 1] += amount
    elif kind == "cut":
        time, values = (np.delete(a, slice(frame, frame + int(amount)), axis=0) for a in (time, values))
    elif kind == "shift":
        values = np.roll(values, int(amount), axis=0)
    elif kind == "drop":
        return Recording({n: c for n, c in recording.channels.items() if n != name}, recording.metadata)
    else:
        raise ValueError(kind)
    return recording.with_channels({name: replace(signal, time=time, values=values)})
