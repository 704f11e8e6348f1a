#!/usr/bin/env python
"""A data set by submitit: one job for each sequence, then the set's own files.

    python scripts/tools/farm/pecs_dataset_submitit.py RECIPE.toml SET [--local] [--partition NAME] [--cpus 8]

--local: on this machine, one after the other. A job that was lost is submitted by running this again.
"""

import argparse
import sys
from pathlib import Path

import submitit
from pecs.datasets import cli, manifest, recipe


def make(*words: str) -> None:
    code = cli.main(list(words))
    if code:
        raise RuntimeError(f"pecs dataset {' '.join(words)}: exit code {code}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recipe")
    parser.add_argument("output")
    parser.add_argument("--local", action="store_true")
    parser.add_argument("--partition")
    parser.add_argument("--cpus", type=int, default=8)
    parser.add_argument("--hours", type=float, default=4)
    args = parser.parse_args()
    executor = submitit.AutoExecutor(folder=f"{args.output}/jobs", cluster="local" if args.local else None)
    executor.update_parameters(timeout_min=round(60 * args.hours), cpus_per_task=args.cpus)
    if args.partition:
        executor.update_parameters(slurm_partition=args.partition)
    found = recipe.load(Path(args.recipe))
    lost = []
    jobs = {}
    for index in manifest.missing(found, Path(args.output)):
        jobs[index] = executor.submit(make, args.recipe, "-o", args.output, "--only", str(index))
        if args.local:  # they would share its cores
            jobs[index].wait()
    for index, job in jobs.items():
        try:
            job.result()
        except Exception as e:  # the others are good
            lost.append(index)
            print(f"sequence {index:04d}: {e}", file=sys.stderr)
    if lost:
        sys.exit(f"lost: {', '.join(map(str, lost))}; run again")
    make(args.recipe, "-o", args.output)


if __name__ == "__main__":
    main()
