"""What the benchmarks share: running programs and measuring them, and what a result says of its machine and commit.
Standard library only: a process counts its parent's memory until it has started, so the parent has to be small."""
import datetime
import hashlib
import json
import os
import pathlib
import platform
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = pathlib.Path(os.environ.get("LAPSEAM_DATA", ROOT.parent / "shared/data"))
BUILD = ROOT / "build/release"


class Failed(Exception):
    pass


def words(command):
    return [str(word) for word in command]


def run(*command, timeout_s=None, environment=None):
    """Wall and processor seconds and peak resident bytes of a process that must succeed, with the children that it
    waited for."""
    with tempfile.TemporaryFile() as messages:
        begin = time.monotonic()
        process = subprocess.Popen(words(command), stdout=subprocess.DEVNULL, stderr=messages,
                                   env={**os.environ, **(environment or {})}, start_new_session=True)
        timer = None
        if timeout_s:
            timer = threading.Timer(timeout_s, os.killpg, (process.pid, signal.SIGKILL))
            timer.start()
        try:
            usage = finish(process)
        except BaseException:  # the process has a session of its own: Ctrl-C does not reach it
            os.killpg(process.pid, signal.SIGKILL)
            raise
        finally:
            if timer:
                timer.cancel()
        wall_s = time.monotonic() - begin
        if process.returncode:
            messages.seek(0)
            why = f"took over {timeout_s} s" if timeout_s and wall_s >= timeout_s else f"exit code {process.returncode}"
            raise Failed(" ".join(words(command)) + f": {why}\n" + messages.read().decode(errors="replace")[-2000:])
        return cost_of(wall_s, usage)


def finish(process):
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage


def cost_of(wall_s, usage):
    return {"wall_s": wall_s, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_rss_bytes": usage.ru_maxrss * 1024}


class MemorySampler(threading.Thread):
    """Resident memory of a process over time: (seconds, all of it, what is not file pages), bytes."""

    def __init__(self, pid, begin, period_s):
        super().__init__(daemon=True)
        self.pid, self.begin, self.period_s = pid, begin, period_s
        self.samples, self.is_done = [], threading.Event()

    def run(self):
        page = os.sysconf("SC_PAGE_SIZE")
        while not self.is_done.wait(self.period_s):
            try:
                fields = pathlib.Path(f"/proc/{self.pid}/statm").read_text().split()
            except OSError:
                return
            resident, shared = int(fields[1]) * page, int(fields[2]) * page
            if resident:
                self.samples.append((round(time.monotonic() - self.begin, 4), resident, resident - shared))

    def stop(self):
        self.is_done.set()
        self.join()
        return self.samples


def run_stages(*command, period_s=0.05):
    """run() for lapseam with `--progress json`: also its stages, from the events, and its memory over time. A stage may lie
    within another. The peak of a stage is that of the samples taken in it: None when it was too short for one."""
    begin = time.monotonic()
    process = subprocess.Popen([*words(command), "--progress", "json"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                               text=True)
    sampler = MemorySampler(process.pid, begin, period_s)
    sampler.start()
    lines = [(time.monotonic() - begin, line) for line in process.stderr]
    usage = finish(process)
    cost = cost_of(time.monotonic() - begin, usage)
    samples = sampler.stop()
    if process.returncode:
        raise Failed(" ".join(words(command)) + "\n" + "".join(line for _, line in lines)[-2000:])
    return {**cost, "stages": stages_of(lines, samples), "samples": samples}


def stages_of(lines, samples):
    """Stages of the same name add up."""
    stages = {}
    for at, line in lines:
        event = json.loads(line) if line.startswith("{") else {}
        if event.get("event") != "end":
            continue
        stage = stages.setdefault(event["stage"], {"name": event["stage"], "seconds": 0, "spans": []})
        stage["seconds"] += event["seconds"]
        stage["spans"].append((max(0, at - event["seconds"]), at))
    for stage in stages.values():
        inside = [memory for at, memory, _ in samples if any(a <= at <= b for a, b in stage["spans"])]
        stage["peak_rss_bytes"] = max(inside, default=None)
    return list(stages.values())


def interleaved(cases, repeat, measure, journal=None):
    """measure(case) `repeat` times each, a round of all cases after the other, so that what else the machine does falls
    on all alike. Lists by case; an empty one for a case that failed. A journal is a file to which each measurement is added
    as it is made; those that it holds already are not made again."""
    results, broken = read_journal(cases, journal)
    for made in results.values():
        made += [None] * (repeat - len(made))
    for turn in range(repeat):
        for case in cases:
            if case in broken or results[case][turn] is not None:
                continue
            try:
                results[case][turn] = measure(case)
                add_to_journal(journal, case, results[case][turn])
            except Failed as failure:
                say(f"{case}: failed: {failure}")
                broken.add(case)
                add_to_journal(journal, case, None)
    return {case: [] if case in broken else made[:repeat] for case, made in results.items()}


def read_journal(cases, journal):
    results, broken = {case: [] for case in cases}, set()
    for line in journal.read_text().splitlines() if journal and journal.exists() else []:
        entry = json.loads(line)
        case = tuple(entry["case"]) if isinstance(entry["case"], list) else entry["case"]
        if case in results and entry["measured"] is None:
            broken.add(case)
        elif case in results:
            results[case].append(entry["measured"])
    return results, broken


def add_to_journal(journal, case, measured):
    if journal:
        journal.parent.mkdir(parents=True, exist_ok=True)
        with open(journal, "a") as file:
            file.write(json.dumps({"case": case, "measured": measured}) + "\n")


def journal_of(arguments):
    """Beside the result; begun anew unless --resume says otherwise."""
    journal = arguments.json.with_name(arguments.json.name + ".runs")
    if not arguments.resume:
        journal.unlink(missing_ok=True)
    return journal


def medians(runs, keys=("wall_s", "cpu_s", "peak_rss_bytes")):
    return {key: statistics.median(r[key] for r in runs) for key in keys}


def median_stages(runs):
    """Of several run_stages(): for each stage its median seconds and highest peak."""
    stages = {}
    for one in runs:
        for stage in one["stages"]:
            stages.setdefault(stage["name"], []).append(stage)
    return [{"name": name, "seconds": statistics.median(s["seconds"] for s in each),
             "peak_rss_bytes": max((s["peak_rss_bytes"] for s in each if s["peak_rss_bytes"]), default=None)}
            for name, each in stages.items()]


def say(*text):
    print(*text, file=sys.stderr, flush=True)


def sha256(file):
    digest = hashlib.sha256()
    with open(file, "rb") as stream:
        for block in iter(lambda: stream.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def commit(root=ROOT):
    found = subprocess.run(["git", "-C", root, "describe", "--always", "--dirty", "--exclude=*"], stdout=subprocess.PIPE,
                           stderr=subprocess.DEVNULL, text=True)
    return found.stdout.strip()


def processor():
    try:
        for line in open("/proc/cpuinfo"):
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def machine():
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {"processor": processor(), "processors": os.cpu_count(), "memory_bytes": memory, "system": platform.platform(),
            "load_average_at_start": os.getloadavg()[0]}


def result_head(name):
    """What every result file begins with."""
    return {"format": f"lapseam-{name}", "version": 1, "commit": commit(), "machine": machine(),
            "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")}


def write_json(file, content):
    file = pathlib.Path(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(file.name + ".part")
    part.write_text(json.dumps(content, indent=1) + "\n")
    part.replace(file)


def comma_list(text, kind=str):
    return [kind(word) for word in text.split(",") if word]


def tool_has(tool, option, command="integrate"):
    shown = subprocess.run([str(tool), command, "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return option + " " in shown.stdout or option + "," in shown.stdout
