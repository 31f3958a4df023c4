#!/usr/bin/env python3
"""Wake-up latency of `luna jitter` beside cyclictest (Debian package rt-tests), alternating in the same minutes.

    cargo build --release && sudo benches/beside_cyclictest.py [--rounds 6] [--loops 10000] [--interval 1000] [--core 1]

Both run one loop under SCHED_FIFO 80 on one core, with memory locked and /dev/cpu_dma_latency at 0, which cyclictest
sets by itself. Prints every round, then the medians over the rounds and their ratios. cyclictest counts in nanoseconds
(-N), so that nobody gains by rounding.
"""
import argparse
import json
import statistics
import subprocess
import sys


def cyclictest(arguments):
    """Percentiles from its histogram, in µs; what is beyond 1 ms counts as 1 ms there."""
    command = ["cyclictest", "-m", "-q", "-N", "-p", "80", "-t", "1", "-a", str(arguments.core),
               "-i", str(arguments.interval), "-l", str(arguments.loops), "-h", "1000000"]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    counts, overflows, maximum = [], 0, 0
    for line in output.splitlines():
        if line.startswith("# Histogram Overflows:"):
            overflows = int(line.split()[-1])
        elif line.startswith("# Max Latencies:"):
            maximum = int(line.split()[-1])
        elif line and line[0].isdigit():
            nanos, count = line.split()
            if int(count):
                counts.append((int(nanos), int(count)))
    counts.append((1_000_000, overflows))
    total = sum(count for _, count in counts)

    def percentile(percent):
        left = total * percent / 100
        for nanos, count in counts:
            left -= count
            if left <= 0:
                return nanos / 1000
        return maximum / 1000

    return percentile(50), percentile(99), percentile(99.9), maximum / 1000


def luna(arguments):
    command = [arguments.luna, "jitter", "--json", "--policy", "fifo:80", "--core", str(arguments.core),
               "--interval", str(arguments.interval), "--loops", str(arguments.loops)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    measured = json.loads(output)
    if measured["policy"] != "fifo:80":
        sys.exit(f"luna obtained policy {measured['policy']}: run this as root")
    latency = measured["loops"][0]["wake_latency_ns"]
    return tuple(latency[key] / 1000 for key in ("p50", "p99", "p99_9", "max"))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--loops", type=int, default=10_000)
    parser.add_argument("--interval", type=int, default=1000, help="µs")
    parser.add_argument("--core", type=int, default=1)
    parser.add_argument("--luna", default="target/release/luna")
    arguments = parser.parse_args()
    rows = {"luna": [], "cyclictest": []}
    print(f"{'':<12} {'p50':>8} {'p99':>8} {'p99.9':>8} {'max':>9}   µs")
    for number in range(arguments.rounds):
        # Who goes first alternates too.
        order = [("luna", luna), ("cyclictest", cyclictest)]
        for name, measure in order if number % 2 == 0 else reversed(order):
            row = measure(arguments)
            rows[name].append(row)
            print(f"{name:<12} {row[0]:8.2f} {row[1]:8.2f} {row[2]:8.2f} {row[3]:9.2f}", flush=True)
    ours, theirs = ([statistics.median(column) for column in zip(*rows[name])] for name in ("luna", "cyclictest"))
    print("medians")
    print(f"{'luna':<12} {ours[0]:8.2f} {ours[1]:8.2f} {ours[2]:8.2f} {ours[3]:9.2f}")
    print(f"{'cyclictest':<12} {theirs[0]:8.2f} {theirs[1]:8.2f} {theirs[2]:8.2f} {theirs[3]:9.2f}")
    print(f"{'ratio':<12} {ours[0] / theirs[0]:8.2f} {ours[1] / theirs[1]:8.2f}")


if __name__ == "__main__":
    main()
