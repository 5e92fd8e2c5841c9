#!/usr/bin/env python3
"""Runs fuzz targets and notes what they did.

    run.py [TARGET ...] [--runs N] [--seconds S] [--jobs J]

Without a target every one in src/bin/ is run, J at a time. A target stops after N inputs or S seconds, whichever comes
first, or at the first input that it does not survive, which is left in artifacts/TARGET/. What it finds goes to
found/TARGET/, which the next run begins with besides corpus/TARGET/. The figures go to results.csv and README.md.
"""

import argparse
import concurrent.futures
import csv
import os
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
RESULTS = HERE / "results.csv"
COLUMNS = ["target", "executions", "seconds", "exec/s", "edges", "features", "corpus", "peak RSS MB", "outcome"]
# Seconds for one input, MB for the process, and bytes of the longest input: most bytes of a longer one do not matter.
LIMITS = ["-timeout=10", "-rss_limit_mb=4096"]
LONGEST, LONGEST_OF = 8192, {"vdb": 32768}


# Without a sanitizer the stable compiler does; the memory in use is watched by the targets themselves.
BUILD = ["cargo", "fuzz", "build", "--fuzz-dir", str(HERE), "--sanitizer", "none"]


def program(target):
    """The newest build of a target; its folder is named after the machine's kind."""
    return max((HERE / "target").glob(f"*/release/{target}"), key=lambda path: path.stat().st_mtime)


def fuzz(target, runs, seconds):
    """Runs one target and returns its row of the table."""
    folders = [HERE / "found" / target, HERE / "corpus" / target]
    artifacts = HERE / "artifacts" / target
    for folder in [*folders, artifacts]:
        folder.mkdir(parents=True, exist_ok=True)
    dictionary = HERE / "dict" / f"{target}.dict"
    options = [f"-runs={runs}", f"-max_total_time={seconds}", "-print_final_stats=1", *LIMITS]
    options.append(f"-max_len={LONGEST_OF.get(target, LONGEST)}")
    options += [f"-artifact_prefix={artifacts}/"]
    options += [f"-dict={dictionary}"] if dictionary.is_file() else []
    memory = "/dev/shm" if os.path.isdir("/dev/shm") else None
    with tempfile.TemporaryDirectory(prefix="stereomist-fuzz", dir=memory) as folder:
        environment = {**os.environ, "TMPDIR": folder}
        # A process begins with the peak of the one that starts it, which is cargo's or Python's but for a shell between.
        line = ["sh", "-c", '"$@"; exit $?', "sh", str(program(target)), *map(str, folders), *options]
        done = subprocess.run(line, cwd=HERE, env=environment, stderr=subprocess.PIPE, errors="replace")
    text = done.stderr
    (HERE / "found" / f"{target}.log").write_text(text)

    def last(pattern):
        return (re.findall(pattern, text) or ["?"])[-1]

    executions = last(r"stat::number_of_executed_units: (\d+)")
    if executions == "?":
        executions = last(r"#(\d+)\s")
    kept = last(r"corp: (\d+)")
    took = last(r"Done \d+ runs in (\d+) second")
    rate = last(r"stat::average_exec_per_sec:\s+(\d+)")
    memory = last(r"stat::peak_rss_mb:\s+(\d+)")
    outcome = "survived" if done.returncode == 0 else "see " + last(r"Test unit written to \S*?(artifacts/\S+)")
    print(f"{target}: {executions} inputs, {outcome}", flush=True)
    return [target, executions, took, rate, last(r"cov: (\d+)"), last(r"ft: (\d+)"), kept, memory, outcome]


def write(rows):
    """Replaces the rows of these targets in the table of both files."""
    table = {}
    if RESULTS.is_file():
        with RESULTS.open(newline="") as file:
            table = {row[0]: row for row in list(csv.reader(file))[1:]}
    table.update({row[0]: row for row in rows})
    table = [table[target] for target in sorted(table)]
    with RESULTS.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *table])
    lines = [COLUMNS, ["---"] * len(COLUMNS), *table]
    text = "".join("| " + " | ".join(line) + " |\n" for line in lines)
    readme = HERE / "README.md"
    begin, end = "<!-- results -->\n", "<!-- end of results -->"
    before, rest = readme.read_text().split(begin)
    readme.write_text(before + begin + text + end + rest.split(end)[1])


def main():
    targets = sorted(path.stem for path in (HERE / "src" / "bin").glob("*.rs"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(targets))
    parser.add_argument("--runs", type=int, default=-1, help="inputs; -1, the default: no bound")
    parser.add_argument("--seconds", type=int, default=180, help="0: no bound")
    parser.add_argument("--jobs", type=int, default=1, help="targets at a time")
    arguments = parser.parse_args()
    chosen = arguments.targets or targets
    unknown = set(chosen) - set(targets)
    if unknown:
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(targets)}")
    if subprocess.run(BUILD, cwd=ROOT).returncode != 0:
        sys.exit("the targets cannot be built")
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(lambda target: fuzz(target, arguments.runs, arguments.seconds), chosen))
    write(rows)
    sys.exit(any(row[-1] != "survived" for row in rows))


main()
