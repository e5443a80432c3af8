"""Snakemake: finds it and lets it work off a plan."""
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
HOME = HERE.parents[1] / "build" / "fleet"  # what './bootstrap fleet' makes


class EngineError(Exception):
    """Snakemake is not there."""


def find_snakemake():
    home = pathlib.Path(os.environ.get("CALIBRATE_FLEET_HOME") or HOME)
    own = home / "venv" / "bin" / "snakemake"
    program = str(own) if own.is_file() else shutil.which("snakemake")
    if program is None:
        raise EngineError("Snakemake is not installed: call './bootstrap fleet' once (or install the package snakemake)")
    return program


def write_plan(path, runs, program, words):
    """Leaves the file alone if it says the same: its date tells the engine nothing then."""
    task = ["/usr/bin/python3", str(HERE / "task.py")]
    text = json.dumps({"program": str(program), "calibrate": words, "task": task, "runs": runs}, indent=1) + "\n"
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def work_off(plan, cores, options):
    """@param options of Snakemake, as one string  @return whether every task has a record"""
    # The user's options come last and win, --cores too.
    command = [find_snakemake(), "--snakefile", str(HERE / "Snakefile"), "--directory", str(plan.parent),
               "--config", "plan={}".format(plan), "--keep-going", "--rerun-incomplete", "--rerun-triggers", "mtime",
               "params", "--quiet", "rules", "--cores", str(cores)] + shlex.split(options)
    with (plan.parent / "engine.log").open("a") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            for line in process.stdout:
                log.write(line)
                if "steps (" in line:
                    print(line.strip(), file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            pass  # Snakemake heard it as well and ends its tasks
    return process.wait() == 0
