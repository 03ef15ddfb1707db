#!/usr/bin/env python3
"""Draws NAME.png beside NAME.csv for the studies that a picture helps. Usage: plot.py FOLDER [NAME...]"""
import csv
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


def rows_of(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream))


def first_speed(rows, axes):
    """Speed against accuracy: one point per method, one line per resolution."""
    for patches in dict.fromkeys(row["patches"] for row in rows):
        chosen = [row for row in rows if row["patches"] == patches]
        axes.plot([float(r["GL ms"]) for r in chosen], [max(1e-4, float(r["error (% rms)"])) for r in chosen], "o", label=patches)
        for row in chosen:
            axes.annotate(row["method"], (float(row["GL ms"]), max(1e-4, float(row["error (% rms)"]))), xytext=(6, 4), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="GL, ms a solve", ylabel="error, % rms of the target")
    axes.legend(title="patches")


def two_wall_loop(rows, axes):
    """Suppression per room, with the ceiling of the photographs and a model whose k is 20 % wrong."""
    rows = [row for row in rows if row["suppression"] != "-"]  # a refused room has no bars; the table names it
    seeds = range(len(rows))
    for offset, (column, label) in enumerate([("suppression", "measured model"), ("ceiling", "perfect show, same photos"), ("k x 1.2", "k 20 % wrong")]):
        axes.bar([s + 0.27 * (offset - 1) for s in seeds], [float(r[column]) for r in rows], 0.25, label=label)
    axes.axhline(20, color="0.4", lw=0.8)
    axes.set(yscale="log", xlabel="room", ylabel="suppression", xticks=list(seeds), xticklabels=[row["seed"] for row in rows])
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=3, frameon=False)


def sim_speed(rows, axes):
    """Photos a second against the camera's size, and against the number of projectors."""
    for column, kept, label in [("camera Mpx", "projectors", "by camera Mpx, 2 projectors"), ("projectors", "camera Mpx", "by projectors, 2.1 Mpx")]:
        chosen = sorted((float(r[column]), float(r["photos per s"])) for r in rows if r[kept] == rows[0][kept])
        axes.plot(*zip(*chosen), "o-", label=label)
    axes.axhline(6, color="0.4", lw=0.8)
    axes.set(xscale="log", yscale="log", xlabel="camera Mpx, or projectors", ylabel="photos per s")
    axes.legend()


PLOTS = {"first-speed": first_speed, "sim-speed": sim_speed, "two-wall-loop": two_wall_loop}


def main():
    folder, names = pathlib.Path(sys.argv[1]), sys.argv[2:] or list(PLOTS)
    for name in names:
        source = folder / f"{name}.csv"
        if name not in PLOTS or not source.exists():
            continue
        figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
        PLOTS[name](rows_of(source), axes)
        figure.savefig(folder / f"{name}.png", dpi=130)
        print(folder / f"{name}.png")


main()
