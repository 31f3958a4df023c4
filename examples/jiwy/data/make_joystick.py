#!/usr/bin/env python3
"""Writes joystick.csv: a synthetic joystick recording. See README.md; `python3 make_joystick.py > joystick.csv`."""

import math
import random
import sys

RATE = 100  # samples a second
LENGTH = 24  # seconds
STEPS = 127  # of an 8-bit stick: deflections are multiples of 1/127
SEED = 2  # fixed, so that each run writes the same file


def ease(x):
    """0 to 1 with no jump in speed: how a hand moves from one position to another."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


def sweep(t, start, end, frequency, amplitude):
    """A sine-like motion from `start` to `end`, growing and fading over half a second."""
    if not start <= t <= end:
        return 0.0
    envelope = ease((t - start) / 0.5) * ease((end - t) / 0.5)
    return amplitude * envelope * math.sin(2.0 * math.pi * frequency * (t - start))


def hold(t, start, end, level):
    """Moves to `level` within 0.4 s after `start` and back to the middle within 0.4 s before `end`."""
    return level * ease((t - start) / 0.4) * ease((end - t) / 0.4)


def hand(t):
    """Where the hand wants the stick: pan, tilt."""
    pan = sweep(t, 3.0, 8.0, 0.4, 0.85) + hold(t, 9.5, 12.5, -0.7) + hold(t, 14.0, 18.0, 0.45) + sweep(t, 19.0, 23.0, 0.5, 0.6)
    tilt = sweep(t, 5.0, 10.0, 0.4, 0.7) + hold(t, 11.0, 13.5, 0.6) + hold(t, 14.5, 17.5, -0.5) + sweep(t, 19.5, 22.5, 1.0, 0.5)
    return pan, tilt


def main():
    """Adds what a hand and a cheap stick add: drift and tremor while deflected, electrical noise, rare spikes, steps."""
    noise = random.Random(SEED)
    tremor = [0.0, 0.0]
    out = sys.stdout
    out.write("time,pan,tilt\n")
    for n in range(LENGTH * RATE + 1):
        t = n / RATE
        row = []
        for axis, wanted in enumerate(hand(t)):
            # A first-order random walk back to zero: the hand's tremor, stronger the further the stick is held out.
            tremor[axis] += -0.25 * tremor[axis] + noise.gauss(0.0, 0.015)
            value = wanted + tremor[axis] * min(1.0, 3.0 * abs(wanted)) + noise.gauss(0.0, 0.003)
            if noise.random() < 0.002:
                value += noise.choice((-0.08, 0.08))  # the potentiometer's wiper loses contact for a moment
            value = min(max(value, -1.0), 1.0)
            row.append(round(value * STEPS) / STEPS)
        out.write(f"{t:.2f},{row[0]:.4f},{row[1]:.4f}\n")


if __name__ == "__main__":
    main()
