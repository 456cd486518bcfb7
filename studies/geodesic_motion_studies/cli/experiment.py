"""`experiment`: what the method is claimed to do, measured; a table and a figure each."""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, writable
from geodesic_motion_ros.utils.errors import ExperimentError
from geodesic_motion_ros.utils.tables import text_table, write_json
from geodesic_motion_studies.experiments.registry import STUDIES, Entry

if TYPE_CHECKING:
    from geodesic_motion_studies.experiments.study import OfOwnData, Study

_DESCRIPTION = """\
{studies}
all             all that need no recording, with their default arguments, on all cores; what they print: NAME/log.txt

What the paper shows and what these show stands in studies/geodesic_motion_studies/experiments/README.md. Table, figure
and JSON go to out/experiments/NAME/. Skills that are trained for a study are kept in out/experiments/skills and taken
from there when data, settings and training code are the same; so are the models of circle, in out/experiments/models.
"""
_EPILOG = """\
examples:
  geodesic-motion experiment toy-task
  geodesic-motion experiment geodesics --skill panda_pouring
  geodesic-motion experiment avoidance --demos pouring.npy bottle2shelf.npy --units cm --folds 0,3,6/1,4,7/2,5,8
  geodesic-motion experiment crossing --demos pouring.npy --units cm
  geodesic-motion experiment goals --shown 20
  geodesic-motion experiment modes --save two_modes.npz
  geodesic-motion experiment whole-arm --moving-scenes 500 --processes 2
  geodesic-motion experiment obstacle-laws --scenes 200
  geodesic-motion experiment largest-sphere --skill panda_reach_to_grasp
  geodesic-motion experiment volume
  geodesic-motion experiment all --seeds-from 10000
  geodesic-motion experiment rate --skill panda_reach_to_grasp --rates 100,250,500
"""


class _StudyParser(argparse.ArgumentParser):
    """Gets a study's options, and its file's docstring for a description, when it is used."""

    def __init__(self, *, entry: Entry | None = None, **keywords: Any) -> None:
        super().__init__(**keywords)
        self._entry = entry

    def parse_known_args(self, *arguments: Any, **keywords: Any) -> Any:
        self._complete()
        return super().parse_known_args(*arguments, **keywords)

    def format_help(self) -> str:
        self._complete()
        return super().format_help()

    def _complete(self) -> None:
        if self._entry is None:
            return
        study, self._entry = self._entry.load(), None
        self.description = sys.modules[study.__module__].__doc__
        study.add_options(self)
        self.set_defaults(run=lambda arguments: _run(arguments, study.of(arguments)))


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command and its studies to the parser of the command line."""
    listed = "\n".join(f"{name:<15} {entry.about}" for name, entry in STUDIES.items())
    parser = commands.add_parser(
        "experiment", help="measure what is claimed: geodesics, avoidance, crossing, goals, modes, whole-arm, more",
        description=_DESCRIPTION.format(studies=listed), epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    names = parser.add_subparsers(dest="experiment", metavar="NAME", required=True, parser_class=_StudyParser)
    for name, entry in STUDIES.items():
        names.add_parser(name, formatter_class=HelpFormatter, entry=entry)
    everything = names.add_parser("all", formatter_class=HelpFormatter)
    everything.add_argument(
        "--seeds-from", type=int, default=0, metavar="SEED",
        help="add SEED to every study's default seeds (default: 0, to develop on); tables are of 10000 and more",
    )  # fmt: skip
    everything.set_defaults(run=_all)
    for own in names.choices.values():
        own.add_argument("--out", type=Path, default=Path("out/experiments"), metavar="FOLDER", help="for results")
        add_json(own)


def _run(arguments: argparse.Namespace, study: Study) -> None:
    """Measure, draw and hand over; or save what would have been measured on."""
    if getattr(arguments, "save", None) is not None:
        _save(arguments.save, study)
        return
    folder = _folder(arguments)
    report = study.measure(arguments.out)
    report.draw(folder / f"{arguments.experiment.replace('-', '_')}.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _save(path: Path, study: OfOwnData) -> None:
    """Write a study's demonstrations with equally many samples each, as the file wants them."""
    from geodesic_motion_ros.cli.recorded import evenly_sampled
    from geodesic_motion_ros.demonstrations.writers import save_demonstrations

    demonstrations, contents = study.saved()
    save_demonstrations(evenly_sampled(demonstrations), path)
    print(f"wrote {len(demonstrations)} demonstrations to {path}: {contents}; read them with --units m")


def _all(arguments: argparse.Namespace) -> None:
    """Run every study as it is by default, on all cores; what fails is reported and does not stop the others."""
    folder, rows = _folder(arguments), []
    names = [name for name, entry in STUDIES.items() if not entry.of_recordings]
    timed = [name for name in names if STUDIES[name].timed]
    together = [name for name in names if name not in timed]
    cores = len(os.sched_getaffinity(0))
    for name in names:
        _folder(_arguments_of(name, arguments))
    for several, beside in ((together, cores), (timed, 1)):
        for row in _run_beside(several, beside, arguments):
            rows.append(row)
            said = f"failed: {row['error']}" if row["error"] else "done"
            print(f"[{len(rows)}/{len(names)}] {row['experiment']} {said} in {row['seconds']:.0f} s", flush=True)
    rows.sort(key=lambda row: names.index(row["experiment"]))
    lines = [
        [row["experiment"], "failed" if row["error"] else "done", row["seconds"], row["processor_seconds"],
         row["error"]]
        for row in rows
    ]  # fmt: skip
    table = text_table(["experiment", "", "seconds", "of processor", ""], lines, digits=0, left=(0, 1, 4))
    _hand_over(arguments, folder, table, {"experiments": rows})
    failed = [row["experiment"] for row in rows if row["error"]]
    if failed:
        raise ExperimentError(f"{len(failed)} of {len(rows)} experiments failed: {', '.join(failed)}")


def _run_beside(names: Sequence[str], beside: int, arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Run studies in processes of their own, at most so many beside one another; a row for each that has ended."""
    waiting, running = deque(names), {}
    try:
        while waiting or running:
            while waiting and len(running) < beside:
                name = waiting.popleft()
                process = get_context("fork").Process(target=_run_default, args=(name, arguments))
                process.start()
                running[process.sentinel] = name, process, time.monotonic()
            for ended in wait(running):
                name, process, began = running.pop(ended)
                busy = _processor_time()
                process.join()
                took = {"seconds": time.monotonic() - began, "processor_seconds": _processor_time() - busy}
                yield {"experiment": name, **took, "error": _error(process.exitcode, _log(arguments, name))}
    finally:
        for _, process, _ in running.values():
            process.terminate()
            process.join()


def _run_default(name: str, arguments: argparse.Namespace) -> None:
    """Run a study with its default settings; its output goes to log.txt in its folder, an error in the last line."""
    with _log(arguments, name).open("w", buffering=1) as log, redirect_stdout(log), redirect_stderr(log):
        for output in (1, 2):  # of processes that the study starts
            os.dup2(log.fileno(), output)
        try:
            _run(_arguments_of(name, arguments), _seeded(STUDIES[name].load()(), arguments.seeds_from))
        except Exception as failure:
            traceback.print_exc()
            print(" ".join(f"{type(failure).__name__}: {failure}".split()))
            sys.exit(1)


def _arguments_of(name: str, arguments: argparse.Namespace) -> argparse.Namespace:
    """The arguments of one of all experiments."""
    return argparse.Namespace(experiment=name, out=arguments.out, json=None)


def _log(arguments: argparse.Namespace, name: str) -> Path:
    return arguments.out / name / "log.txt"


def _error(exitcode: int, log: Path) -> str:
    """What ended a process, "" where it has finished: the last line that it printed, or the signal that killed it."""
    if exitcode <= 0:
        return f"ended by signal {-exitcode}" if exitcode else ""
    return (log.read_text().splitlines() or [f"exit status {exitcode}"])[-1]


def _seeded(study: Study, first: int) -> Study:
    """A study with its default seeds, so many further on."""
    from geodesic_motion_studies.experiments.study import options

    names, changes = {each.name for each in options(study)}, {}
    if "seeds" in names:
        changes["seeds"] = tuple(seed + first for seed in study.seeds)
    if "seed" in names:
        changes["seed"] = study.seed + first
    return replace(study, **changes)


def _processor_time() -> float:
    """Of the processes that were waited for [s]: it tells on a busy machine what a quiet one takes."""
    times = os.times()
    return times.children_user + times.children_system


def _folder(arguments: argparse.Namespace) -> Path:
    """Where the results of an experiment go; ParameterError where that cannot be written, before anything long."""
    folder = arguments.out / arguments.experiment
    for path in (folder / "table.txt", arguments.json):
        writable(path)
    return folder


def _hand_over(arguments: argparse.Namespace, folder: Path, table: str, content: dict) -> None:
    print(table)
    (folder / "table.txt").write_text(table + "\n")
    write_json(folder / "figures.json", content)
    if arguments.json is not None:
        write_json(arguments.json, content)
    print(f"wrote table, figures and picture to {folder}")
