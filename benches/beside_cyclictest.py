#!/usr/bin/env python3
"""How late a loop wakes up: `luna jitter` beside cyclictest and beside itself, alternating in the same minutes.

    cargo build --release && sudo benches/beside_cyclictest.py [--rounds 5] [--slices 7] [--core 1] [--only NAME...]

Needs cyclictest (Debian package rt-tests) and stress-ng, and takes some 7 minutes. Every side is one loop at 1 kHz under SCHED_FIFO 80 on one
core, memory locked, with /dev/cpu_dma_latency held at 0 for all of them. LUNA stamps in the body, against the scheduled slot.

    idle       LUNA and cyclictest on a machine that does nothing else
    load       the same beside stress-ng on all cores
    guard      LUNA with a guard spin, idle
    guardload  the same under load
    others     LUNA with 99 more loops of 100 Hz to 1 kHz at lower priorities on its executor, and LUNA alone
    burner     LUNA with a thread of lower priority that keeps the core busy for 100 ms at a time, and LUNA alone

A slice is one run of 1000 wake-ups. A round takes the sides in turn, slice by slice, and the side that goes first changes each time; slices in which /proc/stat shows stolen time on
the core are taken again (up to twice as many), and the round's figure is the median over its slices. What is compared are the medians over the rounds, p50 and p99.
Maxima are printed and compare to nothing: a virtual machine's are its host's. cyclictest counts in nanoseconds (-N), so that neither side gains by rounding.
Writes target/bench/wake_up.json.
"""
import argparse
import contextlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

WAKE_UPS = 1000
QUANTILES = ("p50", "p99")


def stolen(core):
    """Ticks that the hypervisor has taken from the core."""
    with open("/proc/stat", encoding="ascii") as file:
        for line in file:
            fields = line.split()
            if fields[0] == f"cpu{core}":
                return int(fields[8])
    return 0


def cyclictest(core):
    """p50, p99 and maximum of one slice in ns; what is beyond 1 ms counts as 1 ms in the first two."""
    with tempfile.NamedTemporaryFile("r", suffix=".json") as found:
        command = ["cyclictest", "-m", "-q", "-N", "-p", "80", "-t", "1", "-a", str(core), "-i", "1000", "-l", str(WAKE_UPS),
                   "-h", "1000000", f"--json={found.name}"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        thread = json.load(found)["thread"]["0"]
    counts = sorted((int(nanos), count) for nanos, count in thread["histogram"].items())
    counts.append((1_000_000, thread["cycles"] - sum(count for _, count in counts)))

    def percentile(percent):
        left = thread["cycles"] * percent / 100
        for nanos, count in counts:
            left -= count
            if left <= 0:
                return nanos
        return counts[-1][0]

    return {"p50": percentile(50), "p99": percentile(99), "max": thread["max"]}


def luna(path, *options):
    """The same of `luna jitter`."""
    def measure(core):
        command = [path, "jitter", "--json", "--policy", "fifo:80", "--core", str(core), "--interval", "1000",
                   "--loops", str(WAKE_UPS), *options]
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        measured = json.loads(output)
        if measured["policy"] != "fifo:80":
            sys.exit(f"luna obtained policy {measured['policy']}: run this as root")
        return measured["loops"][0]["wake_latency_ns"]
    return measure


@contextlib.contextmanager
def load(wanted):
    """stress-ng on all cores."""
    if not wanted:
        yield
        return
    command = ["stress-ng", "--quiet", "--cpu", "0", "--vm", "1", "--vm-bytes", "128M", "--switch", "1"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        time.sleep(1)
        try:
            yield
        finally:
            process.terminate()


def rounds_of(arguments, sides):
    """For each side the figures of each round, and the largest maximum."""
    figures = {peer: {key: [] for key in QUANTILES} for peer, _ in sides}
    largest = {peer: 0 for peer, _ in sides}
    left_out = 0
    for _ in range(arguments.rounds):
        slices = {peer: [] for peer, _ in sides}
        for turn in range(2 * arguments.slices):
            for peer, measure in sides if turn % 2 == 0 else sides[::-1]:
                if len(slices[peer]) == arguments.slices:
                    continue
                before = stolen(arguments.core)
                found = measure(arguments.core)
                largest[peer] = max(largest[peer], found["max"])
                if stolen(arguments.core) == before:
                    slices[peer].append(found)
                else:
                    left_out += 1
        for peer, good in slices.items():
            if good:
                for key in QUANTILES:
                    figures[peer][key].append(statistics.median(one[key] for one in good))
    return figures, largest, left_out


def report(name, goals, figures, largest, left_out):
    """Prints a case, and gives its rows."""
    rows = []
    print(f"\n{name}" + (f" ({left_out} slices with stolen time left out)" if left_out else ""))
    for peer, columns in figures.items():
        cells = []
        for key in QUANTILES:
            values = columns[key]
            if not values:
                sys.exit(f"{name}: time was stolen from {peer} in every slice; this machine is too busy to be measured")
            rows.append({"name": f"{name}, {key}", "peer": peer, "unit": "ns", "median": statistics.median(values),
                         "min": min(values), "samples": len(values)})
            cells.append(f"{key} {statistics.median(values) / 1000:8.2f} ({min(values) / 1000:.2f} to {max(values) / 1000:.2f})")
        print(f"  {peer:<12} {'   '.join(cells)}   max {largest[peer] / 1000:.0f} µs")
    ours, *theirs = figures.values()
    for key, kind, limit in goals:
        mine = statistics.median(ours[key])
        if kind == "ratio":
            value = mine / statistics.median(theirs[0][key])
            print(f"  {key}: {value:.3f} x, goal {limit} x: {'met' if value <= limit else 'MISSED'}")
        else:
            print(f"  {key}: {mine:.0f} ns, goal {limit} ns: {'met' if mine <= limit else 'MISSED'}")
    sys.stdout.flush()
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--slices", type=int, default=7, help="in each round, of each side; of one second")
    parser.add_argument("--core", type=int, default=1)
    parser.add_argument("--luna", default="target/release/luna")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these cases alone")
    arguments = parser.parse_args()
    ours = ("LUNA", luna(arguments.luna))
    guarded = ("LUNA", luna(arguments.luna, "--guard", "62"))
    theirs = ("cyclictest", cyclictest)
    alone = ("LUNA alone", ours[1])
    as_reference = [("p50", "ratio", 1.05), ("p99", "ratio", 1.1)]
    cases = [
        ("idle", False, [ours, theirs], as_reference),
        ("load", True, [ours, theirs], as_reference),
        ("guard", False, [guarded], [("p50", "ns", 1000)]),
        ("guardload", True, [guarded], [("p50", "ns", 1000)]),
        ("others", False, [("LUNA", luna(arguments.luna, "--others", "99")), alone], [("p99", "ratio", 1.2)]),
        ("burner", False, [("LUNA", luna(arguments.luna, "--burn", "100")), alone], [("p99", "ratio", 1.1)]),
    ]
    unknown = set(arguments.only or ()) - {name for name, *_ in cases}
    if unknown:
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    rows = []
    with contextlib.ExitStack() as stack:
        try:
            latency = stack.enter_context(open("/dev/cpu_dma_latency", "wb", buffering=0))
            latency.write(bytes(4))
        except OSError as error:
            sys.exit(f"/dev/cpu_dma_latency: {error}; without it idle states differ from side to side")
        for name, loaded, sides, goals in cases:
            if arguments.only and name not in arguments.only:
                continue
            with load(loaded):
                rows += report(f"wake-up, {name}", goals, *rounds_of(arguments, sides))
    folder = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", "target")) / "bench"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "wake_up.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="ascii")


if __name__ == "__main__":
    main()
