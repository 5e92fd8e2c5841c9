"""The CPU against the GPUs that there are, by compute and by raster, and what GPU support costs who does not use it.

    python3 analysis/gpu/run.py [--counts 1000,10000,100000,1000000] [--limit 30] [--binary target/release/stereomist]

Under five minutes on two cores with a software driver. Adapters are named by their class. Where three frames are not done after
--limit seconds the table says so, of larger scenes by the same way too. Writes results.json and the tables of README.md.
"""

import argparse
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
sys.path.insert(0, str(HERE.parent))
from readme import put, short, table  # noqa: E402

SCENE = ROOT / "scenes/walk-1000.toml"
MODEL = ["--set", "render.opacity_model=exponential"]
SIZES = ["256x192", "512x384", "1024x768"]
METHODS = ["viewplane", "viewpoint", "perspective", "spherical", "sheet", "slab"]
# For what does not vary.
SIZE, METHOD, COUNT = "512x384", "perspective", 10_000
# Of the compute path, by where particles are listed: `project` on the device, `transform` on the CPU.
STAGES = ["project", "transform", "order", "bin", "upload", "compute", "read back"]
STARTS = 21
# Milliseconds of a frame that is not measured more often.
SLOW = 300


class Study:
    def __init__(self, binary, limit):
        self.binary, self.limit = binary, limit
        # What is measured is named: no calibration is read or left.
        self.cache = tempfile.TemporaryDirectory()
        self.environment = {**os.environ, "XDG_CACHE_HOME": self.cache.name, "NODEVICE_SELECT": "1"}

    def ask(self, *words, limit=None):
        """The JSON that a command prints; nothing after `limit` seconds or where it refuses."""
        try:
            done = subprocess.run(
                [self.binary, *map(str, words)], capture_output=True, text=True, timeout=limit, env=self.environment
            )
        except subprocess.TimeoutExpired:
            return None
        if done.returncode != 0:
            return {"refused": done.stderr.strip()}
        return json.loads(done.stdout)

    def ways(self):
        """What draws: name, and options for it."""
        found = [("CPU", ["--device", "cpu"])]
        listed = self.ask("devices", "--json")["gpus"]
        for gpu in listed:
            if gpu["lacks"]:
                continue
            kind = f"software driver ({gpu['name'].split()[0]})" if gpu["class"] == "software" else f"{gpu['class']} GPU"
            for path in ["compute", "raster"]:
                found.append((f"{kind}, {path}", ["--device", f"gpu:{gpu['name']}", "--gpu-path", path]))
        if all(gpu["class"] == "software" for gpu in listed):
            found.append(("hardware GPU", None))
        return found

    def scene(self, count):
        """The scene with so many particles, smaller with the cube root of their number."""
        path = pathlib.Path(self.cache.name) / f"{count}.toml"
        radius = 0.4 * (1000 / count) ** (1 / 3)
        text = re.sub(r"^count = .*$", f"count = {count}", SCENE.read_text(), flags=re.M)
        path.write_text(re.sub(r"^radius = .*$", f"radius = {radius}", text, flags=re.M))
        return path

    def frame(self, way, count, size, method):
        """Milliseconds of a frame: the median of seven after two, or the faster of two after one where that is slow."""
        if way is None:
            return "not measured"
        words = ["bench", self.scene(count), *MODEL, *way, "--method", method, "--size", size, "--json"]
        found = self.ask(*words, "--repeat", 2, "--warmup", 1, limit=self.limit)
        if found is None:
            return f"three take more than {self.limit:g} s"
        if "refused" in found:
            return "-"
        if found["min_ms"] > SLOW:
            return found["min_ms"]
        return self.ask(*words, "--repeat", 7, "--warmup", 2)["median_ms"]

    def rows(self, ways, points):
        """A row per way; after one that took too long no larger one is tried."""
        rows = {}
        for name, way in ways:
            rows[name] = []
            for count, size, method, grows in points:
                slow = [told for told in rows[name] if isinstance(told, str) and told.startswith("three")]
                told = slow[0] if grows and slow else self.frame(way, count, size, method)
                print(name, count, size, method, told, file=sys.stderr)
                rows[name].append(told)
        return rows

    def stages(self, ways):
        """Milliseconds of each stage of the compute path: medians of three after one; a stage that did not run has none."""
        rows = {}
        for name, way in ways:
            if not name.endswith("compute"):
                continue
            words = ["bench", self.scene(COUNT), *MODEL, *way, "--method", METHOD, "--size", SIZE, "--json"]
            found = self.ask(*words, "--repeat", 3, "--warmup", 1)["stages"]
            rows[name] = [found.get(stage) for stage in STAGES]
        return rows

    def starts(self):
        """Milliseconds from start to exit of a small `render`, in turns."""
        with tempfile.TemporaryDirectory() as name:
            scene = pathlib.Path(name) / "small.toml"
            text = SCENE.read_text().replace("count = 1000", "count = 100").replace("[1024, 768]", "[64, 48]")
            scene.write_text(text)
            hidden = {**self.environment, "VK_DRIVER_FILES": "/nonexistent", "VK_ICD_FILENAMES": "/nonexistent"}
            render = ["render", scene, "--method", METHOD, "-o", name, "--quiet", "--device"]
            runs = {
                "render --device cpu": ([*render, "cpu"], self.environment),
                "render --device auto": ([*render, "auto"], self.environment),
                "render --device auto, no driver installed": ([*render, "auto"], hidden),
                "devices (loads the drivers)": (["devices"], self.environment),
            }
            took = {what: [] for what in runs}
            for turn in range(STARTS + 1):
                for what, (words, environment) in runs.items():
                    start = time.perf_counter()
                    subprocess.run([self.binary, *map(str, words)], check=True, capture_output=True, env=environment)
                    if turn:
                        took[what].append((time.perf_counter() - start) * 1e3)
        return {what: {"median": statistics.median(times), "fastest": min(times)} for what, times in took.items()}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--counts", default="1000,10000,100000,1000000")
    parser.add_argument("--limit", type=float, default=30)
    parser.add_argument("--binary", type=pathlib.Path, default=ROOT / "target/release/stereomist")
    options = parser.parse_args()
    counts = [int(word) for word in options.counts.split(",")]
    study = Study(str(options.binary.resolve()), options.limit)
    ways = study.ways()
    results = {
        "counts": counts,
        "growth": study.rows(ways, [(count, SIZE, METHOD, True) for count in counts]),
        "sizes": study.rows(ways, [(COUNT, size, METHOD, True) for size in SIZES]),
        "methods": study.rows(ways, [(COUNT, SIZE, method, False) for method in METHODS]),
        "stages": study.stages(ways),
        "start": study.starts(),
    }
    (HERE / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    write(results)


def write(results):
    """The tables."""
    page = HERE / "README.md"
    cell = lambda told: told if isinstance(told, str) else f"{told:,.0f}" if told >= 1000 else short(told, 3)
    lines = lambda rows: [[name, *map(cell, told)] for name, told in rows.items()]
    header = ["drawn by", *(f"{count:,}, ms" for count in results["counts"])]
    put(page, "growth", table(header, lines(results["growth"])))
    put(page, "sizes", table(["drawn by", *(f"{size}, ms" for size in SIZES)], lines(results["sizes"])))
    put(page, "methods", table(["drawn by", *(f"{method}, ms" for method in METHODS)], lines(results["methods"])))
    ran = lambda told: "-" if told is None else short(told, 3)
    rows = [[name, *map(ran, told)] for name, told in results["stages"].items()]
    put(page, "stages", table(["drawn by", *(f"{stage}, ms" for stage in STAGES)], rows))
    rows = [[what, short(took["median"], 3), short(took["fastest"], 3)] for what, took in results["start"].items()]
    put(page, "start", table(["command", "median, ms", "fastest, ms"], rows))


if __name__ == "__main__":
    main()
