#!/usr/bin/env python3
"""Draws NAME.png beside NAME.csv for the studies that a picture helps. Usage: plot.py FOLDER [NAME...]
or plot.py FOLDER sweep NAME...: those of sweeps; `all` = every one that lies there. Options (--..) are not for us."""
import csv
import json
import pathlib
import sys
import textwrap

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


SAID = {"nothing": ("o", "said nothing"), "PASS": ("o", "verify: PASS"), "note": ("P", "a note of capture"), "held-out": ("D", "held-out error above its bound"),
        "few": ("v", "says that few are decoded"), "check": ("^", "check complained"), "calibrate": ("d", "calibrate: a note on the photos"), "FAIL": ("s", "verify: FAIL"), "refused": ("X", "refused (no show)")}
OTHERS = {"none": ":", "paper H=1": "--", "one k": "-."}


def number(text):
    return float("nan") if text == "-" else float(text)


def scale(axes, values):
    """Logarithmic over more than a decade, linear around zero where there is one."""
    values = [v if abs(v) > 1e-3 * max(map(abs, values)) else 0 for v in values]  # a thousandth of the range is none
    sizes = [abs(v) for v in values if v != 0]
    if not sizes or max(sizes) < 4 * min(sizes):
        return
    if len(sizes) == len(values) and min(values) > 0:
        axes.set_xscale("log")
    elif max(sizes) > 10 * min(sizes):
        axes.set_xscale("symlog", linthresh=min(sizes), linscale=0.5)
        axes.set_xlim(0 - 0.4 * min(sizes) if min(values) == 0 else 1.4 * min(values), 1.4 * max(values))


def sweep(rows, labels, figure):
    """Residual by the simulator's truth against the parameter and against its predictor; marks say what the program said."""
    left, right, legend = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1, 1, 0.42]})
    right.sharey(left)
    legend.axis("off")
    series = list(dict.fromkeys(row["series"] for row in rows))
    colours = plt.get_cmap("tab20").colors if len(series) > 10 else [f"C{i}" for i in range(10)]
    single = len(series) == len(rows)  # every series is one point: its name stands beside it
    for axes, column in [(left, "value"), (right, "predictor")]:
        for i, name in enumerate(series):
            chosen = sorted((r for r in rows if r["series"] == name and r[column] != "-"), key=lambda r: number(r[column]))
            at = [number(r[column]) for r in chosen]
            for method, style in OTHERS.items() if axes is left else []:
                axes.plot(at, [number(r[f"{method} % W"]) for r in chosen], style, color=colours[i], lw=0.8, alpha=0.6)
            axes.plot(at, [number(r["ours % W"]) for r in chosen], "-", color=colours[i], lw=1.6, alpha=1 if axes is left else 0.4)
            for row, x in zip(chosen, at):
                shown = row["said"] != "refused"
                y = number(row["ours % W" if shown else "none % W"])  # refused: the plain show is what remains
                axes.plot(x, y, SAID[row["said"]][0], color=colours[i], ms=max(5, 9 - 1.5 * i), mfc="white" if row["said"] in ("PASS", "nothing") else colours[i])
                if single:
                    axes.annotate(name, (x, y), xytext=(6, 3), textcoords="offset points", fontsize=7)
                if row["verdict"] == "silent":
                    axes.plot(x, y, "o", color="red", ms=15, mfc="none", mew=2)
        axes.axhline(float(labels["bound"]), color="0.4", lw=0.8)
        axes.set_yscale("log")
        scale(axes, [number(r[column]) for r in rows if r[column] != "-"])
        axes.grid(alpha=0.2)
    left.set(xlabel=labels["unit"], ylabel="light that is left, % of white")
    right.set(xlabel=labels["predictor"])
    keys = [] if single else [plt.Line2D([], [], color=colours[i], label=name) for i, name in enumerate(series)]
    keys += [plt.Line2D([], [], color="0.3", ls=style, lw=0.8, label=method) for method, style in OTHERS.items()]
    keys += [plt.Line2D([], [], color="0.3", lw=1.6, label="ours")]
    heard = {SAID[row["said"]] + (row["said"],) for row in rows}
    keys += [plt.Line2D([], [], color="0.3", ls="", marker=m, mfc="white" if said in ("PASS", "nothing") else "0.3", label=text) for m, text, said in sorted(heard, key=lambda h: list(SAID).index(h[2]))]
    if any(row["verdict"] == "silent" for row in rows):
        keys.append(plt.Line2D([], [], color="red", ls="", marker="o", ms=11, mfc="none", mew=2, label="wrong in silence"))
    legend.legend(handles=keys, loc="center left", fontsize=8, frameon=False)


def decode_sweep(rows, labels, figure):
    """What was lost and what was wrong by the simulator's truth, against the parameter and against its predictor."""
    upper, lower = figure.subplots(2, 3, gridspec_kw={"width_ratios": [1, 1, 0.5]}, sharey="row")
    series = list(dict.fromkeys(row["series"] for row in rows))
    for line, bound in [(upper, labels["lost bound"]), (lower, labels["bound"])]:
        line[2].axis("off")
        for axes, column in zip(line, ["value", "predictor"]):
            for i, name in enumerate(series):
                chosen = sorted((r for r in rows if r["series"] == name and r[column] != "-"), key=lambda r: number(r[column]))
                least = 0.01  # what is less stands on the floor
                lost = [100 if r["accepted %"] == "-" else max(least, 100 - number(r["accepted %"])) for r in chosen]
                wrong = [max(least, number(r["wrong %"])) if r["wrong %"] != "-" else float("nan") for r in chosen]
                at, y = [number(r[column]) for r in chosen], lost if line is upper else wrong
                axes.plot(at, y, "-", color=f"C{i}", lw=1.6, alpha=1 if column == "value" else 0.4)
                for row, x, one in zip(chosen, at, y):
                    axes.plot(x, one, SAID[row["said"]][0], color=f"C{i}", ms=max(5, 9 - 1.5 * i), mfc="white" if row["said"] in ("PASS", "nothing") else f"C{i}")
                    if row["verdict"] == "silent":
                        axes.plot(x, one, "o", color="red", ms=15, mfc="none", mew=2)
            axes.axhline(float(bound), color="0.4", lw=0.8)
            axes.set_yscale("log")
            axes.set_ylim(0.007, 150)
            scale(axes, [number(r[column]) for r in rows if r[column] != "-"])
            axes.grid(alpha=0.2)
    upper[0].set_ylabel("not decoded, % of visible pixels")
    lower[0].set(xlabel=textwrap.fill(labels["unit"], 56), ylabel="wrong, % of decoded pixels")
    lower[1].set_xlabel(textwrap.fill(labels["predictor"], 56))
    keys = [plt.Line2D([], [], color=f"C{i}", label=name) for i, name in enumerate(series)]
    heard = {SAID[row["said"]] + (row["said"],) for row in rows}
    keys += [plt.Line2D([], [], color="0.3", ls="", marker=m, mfc="white" if said in ("PASS", "nothing") else "0.3", label=text) for m, text, said in sorted(heard, key=lambda h: list(SAID).index(h[2]))]
    if any(row["verdict"] == "silent" for row in rows):
        keys.append(plt.Line2D([], [], color="red", ls="", marker="o", ms=11, mfc="none", mew=2, label="wrong in silence"))
    upper[2].legend(handles=keys, loc="upper left", fontsize=8, frameon=False)


def lens(rows, axes):
    """Share of pixels inside the predicted ellipses, and the held-out error of the real board beside OpenCV's."""
    figure = axes.figure
    axes.remove()
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.5, 1]})
    rigs = [row for row in rows if row["trials"]][::-1]
    for column, marker, colour, label in [("1 sigma %", "o", "C0", "near points"), ("1 sigma % far", "D", "C1", "directions")]:
        for sigma in (column, column.replace("1", "2", 1)):
            left.plot([float(r[sigma]) for r in rigs], range(len(rigs)), marker, color=colour, label=label if sigma == column else None)
    for expected, name in [(39.3, "one sigma"), (86.5, "two sigma")]:
        left.axvline(expected, color="0.4", lw=0.8)
        left.axvspan(expected - 5, expected + 5, color="0.9", zorder=0)
        left.annotate(name, (expected, len(rigs) - 0.45), ha="center", fontsize=8)
    left.set(xlim=(0, 100), ylim=(-0.6, len(rigs) - 0.1), xlabel="% inside the predicted ellipse", yticks=range(len(rigs)), yticklabels=[r["rig"] for r in rigs])
    left.legend(loc="lower left", fontsize=8)
    board = [row for row in rows if row["held-out px"]]
    for offset, column, label in [(-0.2, "held-out px", "lens"), (0.2, "OpenCV px", "calibrateCamera")]:
        right.bar([i + offset for i in range(len(board))], [float(r[column]) for r in board], 0.38, label=label)
    right.set(xticks=range(len(board)), xticklabels=[r["rig"].split(", ")[1].replace(" held out", "").replace("pose ", "") for r in board], xlabel="pose of graycode-board that is held out", ylabel="error, px rms")
    if board:
        right.legend(fontsize=8)


CODES = {"gray": "C0", "xor-02": "C4", "xor-04": "C2", "micro-phase": "C3", "micro-phase-9": "C1", "embedded": "C6", "phase": "C5"}


def decode_economy(rows, axes):
    """Error against the number of patterns: bias filled, random error open, one point per code, room and exponent."""
    for code, colour in CODES.items():
        chosen = [r for r in rows if r["code"] == code and number(r["albedo"]) > 0.5]
        for column, filled in [("bias px", True), ("random px", False)]:
            axes.plot([int(r["patterns"]) for r in chosen], [number(r[column]) for r in chosen], "o", color=colour, mfc=colour if filled else "none", label=code if filled and chosen else None)
    axes.axhline(0.02, color="0.4", lw=0.8)
    axes.axhline(0.1, color="0.4", lw=0.8, ls="--")
    axes.set(yscale="log", xlabel="patterns for both axes", ylabel="px: bias (filled), random (open)")
    axes.legend(fontsize=8)


def pre_scan(rows, axes):
    """Pixels lost, forecast from eight photos against what decoding then found."""
    rows = [r for r in rows if r["code"] in CODES and r["forecast lost %"] != "-"]  # stripes have no forecast
    for code, colour in CODES.items():
        chosen = [r for r in rows if r["code"] == code]
        if not chosen:
            continue
        at, found = [max(0.01, number(r["forecast lost %"])) for r in chosen], [max(0.01, number(r["lost %"])) for r in chosen]
        axes.plot(at, found, "o", color=colour, mfc="none", ms=4, label=code)
        taken = [i for i, r in enumerate(chosen) if r["chosen"] == "yes"]
        axes.plot([at[i] for i in taken], [found[i] for i in taken], "o", color=colour, ms=6)
    axes.plot([0.01, 100], [0.01, 100], color="0.4", lw=0.8)
    axes.set(xscale="log", yscale="log", xlabel="lost, forecast, % (filled: chosen)", ylabel="lost, found, %")
    axes.legend(fontsize=8)


def decode_real(rows, axes):
    """What the mask is, pose by pose, beside the reason pictures of the two poses that lose most."""
    left = [0.0] * len(rows)
    poses = [r["pose"] for r in rows]
    for column, colour, label in (("accepted % of mask", "#2a7f6f", "accepted"), ("rest: washed out %", "#ff9600", "fine stripes washed out"),
                                  ("rest: edge %", "#888888", "edge"), ("rest: other %", "#d03060", "other")):
        share = [number(r[column]) for r in rows]
        axes[0].barh(poses, share, left=left, color=colour, label=label, height=0.7)
        left = [a + b for a, b in zip(left, share)]
    axes[0].plot([number(r["fixed thresholds %"]) for r in rows], poses, "k|", ms=14, mew=2, label="fixed thresholds accept")
    axes[0].set(xlim=(55, 100), xlabel="% of the white-black mask", ylabel="pose")
    axes[0].invert_yaxis()
    axes[0].legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1), ncol=3)
    worst = sorted(rows, key=lambda r: number(r["accepted % of mask"]))[:2]
    for picture, row in zip(axes[1:], sorted(worst, key=lambda r: r["pose"])):
        picture.imshow(plt.imread(pathlib.Path(sys.argv[1]) / f"decode-real/calibration_{row['pose']}/correspondence/camera-projector-reasons.png"))
        picture.set_title(f"pose {row['pose']}: orange is an uncertain bit, red inconsistent, dark grey dark", fontsize=7)
        picture.axis("off")


def decode_speed(rows, axes):
    """Milliseconds for 42 photos of 1.3 Mpx: in memory, and with reading their files."""
    names = [f"{r['photos']}\n{r['decoder']}" for r in rows]
    for offset, column, label in [(-0.2, "ms in memory", "photos in memory"), (0.2, "ms with files", "with reading the files")]:
        bars = axes.bar([i + offset for i in range(len(rows))], [float(r[column]) for r in rows], 0.38, label=label)
        axes.bar_label(bars, fmt="%.0f", fontsize=8)
    axes.set(yscale="log", ylabel="ms for 42 photos of 1.3 Mpx, two threads", xticks=range(len(rows)), xticklabels=names)
    axes.legend(fontsize=8)


PLOTS = {"decode-speed": decode_speed, "decode-real": decode_real, "lens": lens, "decode-economy": decode_economy, "pre-scan": pre_scan, "first-speed": first_speed, "sim-speed": sim_speed, "two-wall-loop": two_wall_loop}


def sweeps_in(folder):
    return [p.stem for p in sorted(folder.glob("*.json")) if "labels" in json.loads(p.read_text())]


def draw(folder, name):
    source = folder / f"{name}.csv"
    if not source.exists():
        return
    document = folder / f"{name}.json"
    labels = json.loads(document.read_text()).get("labels") if document.exists() else None
    sizes = {"lens": (11, 4.5), "decode-real": (15, 4.2)}
    size = sizes.get(name, (8, 4.5)) if not labels else (13, 7) if "lost bound" in labels else (13, 4.8)
    figure = plt.figure(figsize=size, layout="constrained")
    if labels:
        (decode_sweep if "lost bound" in labels else sweep)(rows_of(source), labels, figure)
    elif name in PLOTS:
        PLOTS[name](rows_of(source), figure.subplots(1, 3) if name == "decode-real" else figure.subplots())
    else:
        return
    figure.savefig(folder / f"{name}.png", dpi=130)
    print(folder / f"{name}.png")


def main():
    folder, names = pathlib.Path(sys.argv[1]), [a for a in sys.argv[2:] if not a.startswith("--")]
    if names[:1] == ["sweep"]:
        names = sweeps_in(folder) if "all" in names else names[1:]
    elif not names:
        names = list(PLOTS)
    for name in names:
        draw(folder, name)


main()
