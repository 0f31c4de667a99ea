"""Tables and figures of docs/evaluation.md about bodies, of results.csv."""

import math

import numpy as np

from . import plots, results, statistics
from .bodies import CLASSES
from .layout import OURS, SHORT, between, named, spread, table
from .measures import CONFIDENCES
from .programs import PROGRAMS
from .results import TRUTH
from .statistics import GAPS, Scores

PEERS = [name for name in PROGRAMS if name not in OURS]
#: Behind by more than this is told body by body: 0.005 of Dice.
BEHIND = 0.005


def headline(scores):
    """Means of each program."""
    rows = []
    everywhere = scores.having("interslice")
    rare = scores.having("SyN") if "SyN" in scores.programs else []
    plan = [(name, name, everywhere) for name in (TRUTH, *scores.programs) if name != "SyN"]
    plan += [("SyN", f"SyN, {len(rare)} of the bodies", rare), ("interslice", "interslice, the same bodies", rare)] if rare else []
    for name, words, bodies in plan:
        bodies = [b for b in bodies if "dice" in scores.rows.get((b, name), {})]
        of = lambda measure: statistics.mean(scores.of(bodies, name, measure))  # noqa: E731
        row = ["the truth's own voxels" if name == TRUTH else named(words)]
        row += [spread(of("dice"), 4), spread(of("distance"), 3), spread(of("distance95"), 3), spread(of("volume"), 2)]
        row += [spread(of("pieces"), 1, 100), spread(of("handles"), 1, 100), spread(of("crease"), 3)]
        row.append("" if name == TRUTH else f"{np.mean([scores.rows[b, name]['seconds'] for b in bodies]):.2f}")
        rows.append(row)
    head = ["program", "Dice", "distance, mm", "95 %, mm", "volume, % off", "pieces right, %", "handles right, %", "crease", "CPU s"]
    changed = {n: [scores.rows[b, n].get("changed", 0) for b in scores.having(n)] for n in scores.programs}
    touched = [f"{name} on {sum(c > 0 for c in v)}" for name, v in changed.items() if any(v)]
    failed = [f"{name}: {scores.failures(name)}" for name in scores.programs if scores.failures(name)]
    words = f"{len(scores.bodies)} bodies. Given slices come back changed by: {', '.join(touched) or 'none'}. Failures: {'; '.join(failed) or 'none'}."
    return table(head, rows) + "\n\n" + words


def ahead(scores):
    """interslice less each peer, body by body, all measures."""
    rows = []
    for peer in [*OURS[1:], *PEERS]:
        bodies = scores.having("interslice", peer)
        if not bodies:
            continue
        of = lambda measure: statistics.mean(scores.ahead(bodies, peer, measure))  # noqa: E731
        dice = scores.ahead(bodies, peer, "dice")
        row = [peer, between(of("dice"), 1, 1000), between(of("distance"), 1, 1000), between(of("distance95"), 0, 1000), between(of("volume"), 2)]
        row += [between(of("pieces"), 1, 100), between(of("handles"), 1, 100), between(of("crease"), 3)]
        row.append(f"{np.sum(dice > BEHIND)} : {np.sum(dice < -BEHIND)}")
        rows.append(row)
    head = ["interslice beside", "Dice, 0.001", "distance, µm", "95 %, µm", "volume, %", "pieces, %", "handles, %", "crease off 1"]
    return table([*head, "bodies ahead : behind"], rows)


def groups(scores):
    """Dice of interslice, and how far it is ahead of peers, by groups of bodies."""
    peers = [p for p in PEERS if scores.having("interslice", p)]
    rows = []
    for name, members in scores.groups():
        row = None
        for peer in peers:
            bodies = [b for b in scores.having("interslice", peer) if b in set(members)]
            if row is None:
                row = [name, str(len(bodies)), f"{scores.of(bodies, 'interslice', 'dice').mean():.4f}" if bodies else ""]
            row.append(between(statistics.mean(scores.ahead(bodies, peer, "dice")), 1, 1000) if len(bodies) > 1 else "")
        rows.append(row)
    return table(["bodies", "count", "interslice", *(SHORT.get(p, p) for p in peers)], rows)


def behind(scores):
    """The bodies on which interslice is farthest behind SDF + PCHIP, and behind the best of all peers."""
    peers = [p for p in PEERS if p != "SyN" and p in scores.programs]
    bodies = scores.having("interslice", *peers)
    pchip = dict(zip(bodies, scores.ahead(bodies, "SDF PCHIP", "dice")))
    best = {b: max(peers, key=lambda p: scores.rows[b, p]["dice"]) for b in bodies}
    rest = {b: scores.rows[b, "interslice"]["dice"] - scores.rows[b, best[b]]["dice"] for b in bodies}
    rows = []
    for b in sorted(bodies, key=lambda b: min(pchip[b], rest[b]))[:10]:
        dice = scores.rows[b, "interslice"]["dice"]
        rows.append([str(b), scores.kind[b], f"{scores.gap[b]:.2f}", f"{dice:.4f}", f"{scores.rows[b, 'SDF PCHIP']['dice']:.4f}", f"{best[b]}, {dice - rest[b]:.4f}"])
    worse = sum(v < -BEHIND for v in pchip.values())
    words = f"Behind SDF PCHIP by more than {BEHIND:g}: {worse} of {len(bodies)} bodies; behind the best of these peers on that body: "
    words += f"{sum(v < -BEHIND for v in rest.values())}. The ten farthest behind:"
    return words + "\n\n" + table(["body", "class", "gap, inradii", "interslice", "SDF PCHIP", "best peer"], rows)


def reliability(scores):
    """Stated confidence against the share of voxels that are right."""
    counts, bodies = scores.confidences()
    even, odd = (counts[bodies // len(CLASSES) % 2 == parity] for parity in (0, 1))
    right, fresh, said = statistics.shares(counts), statistics.shares(odd), statistics.stated(counts)
    share, rows = counts.sum(0)[:, 0] / counts.sum((0, 1))[0], []
    for i, edge in enumerate(CONFIDENCES):
        name = "1" if i == len(CONFIDENCES) - 1 else f"{edge:g} to {CONFIDENCES[i + 1]:g}"
        of = lambda found: f"{found[0, i]:.4f} [{found[1, i]:.4f}, {found[2, i]:.4f}]"  # noqa: E731
        rows.append([name, f"{100 * share[i]:.2f}", f"{said[i]:.4f}", of(right), of(fresh)])
    head = ["confidence", "voxels, %", "stated, mean", "share that is right, all bodies", "odd bodies"]
    words = f"Mean |stated - right| over voxels below 1: {statistics.calibration_error(odd):.4f} on the odd bodies, which k has not seen, "
    words += f"{statistics.calibration_error(even):.4f} on the even ones. The k of least log loss on the even bodies: {statistics.fit(even):.2f}; "
    words += f"on the odd ones: {statistics.fit(odd):.2f}."
    lines = [plots.Line("as stated", [0.5, 1], [0.5, 1], dashed=True)]
    lines.append(plots.Line("all bodies", list(said), *(list(v) for v in right)))
    for low, high, name in ((0, 0.5, "gap < 0.5 inradius"), (0.5, 1, "0.5 to 1"), (1, math.inf, "1 and more")):
        group = counts[[low <= scores.gap[b] < high for b in bodies]]
        if len(group):
            lines.append(plots.Line(name, list(statistics.stated(group)), *(list(v) for v in statistics.shares(group))))
    ticks = [(v / 10, f"{v / 10:g}") for v in range(5, 11)]
    axes = "confidence that interslice states", "share of voxels that are right"
    svg = plots.figure("Stated confidence and share of right voxels", lines, (0.5, 1), (0.5, 1), ticks, ticks, axes)
    (results.FOLDER / "reliability.svg").write_text(svg)
    return table(head, rows) + "\n\n" + words


def hold_outs(scores):
    """Dice of `evaluate --leave 2` beside that of the slices that were not given."""
    bodies = [b for b in scores.having("interslice") if "holdout" in scores.rows[b, "interslice"]]
    held, true = (np.array([scores.rows[b, "interslice"][name] for b in bodies]) for name in ("holdout", "dice"))
    edges, rows = (0, 0.8, 0.9, 0.95, 0.98, 1.01), []
    for low, high in zip(edges, edges[1:]):
        here = true[(low <= held) & (held < high)]
        if len(here):
            name = f"below {high:g}" if low == 0 else f"{low:g} and more" if high > 1 else f"{low:g} to {high:g}"
            rows.append([name, str(len(here)), f"{here.mean():.4f}", f"{np.percentile(here, 5):.4f}", f"{here.min():.4f}"])
    ranks = [np.argsort(np.argsort(v)) for v in (held, true)]
    words = f"{len(bodies)} bodies, every third of them of which four slices or more are given. The true Dice is above the score on "
    words += f"{100 * np.mean(true >= held):.0f} %, and below it by at most {max(0, (held - true).max()):.3f}; "
    words += f"their ranks correlate by {np.corrcoef(*ranks)[0, 1]:.2f}."
    return table(["Dice of `evaluate --leave 2`", "bodies", "true Dice, mean", "5 of 100 below", "least"], rows) + "\n\n" + words


def gaps(scores):
    """Figure: 1 - Dice by gap over inradius."""
    lines = []
    for name in ("interslice", *(p for p in PEERS if p != "SyN")):
        line = plots.Line(name, [], [])
        for low, high in zip(GAPS, (*GAPS[1:], math.inf)):
            bodies = [b for b in scores.having(name) if low <= scores.gap[b] < high]
            if len(bodies) > 1:
                value, least, most = statistics.mean(1 - scores.of(bodies, name, "dice"))
                middle = math.exp(np.mean([math.log(scores.gap[b]) for b in bodies]))
                for to, v in zip((line.x, line.y, line.low, line.high), (middle, value, least, most)):
                    to.append(v)
        lines.append(line)
    x_ticks, y_ticks = [(v, f"{v:g}") for v in (0.125, 0.25, 0.5, 1, 2, 4)], [(v, f"{v:g}") for v in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)]
    words = "gap over inradius, mean of a bin", "1 - Dice over slices not given"
    svg = plots.figure("What is lost by gap", lines, (0.1, 5), (0.004, 0.5), x_ticks, y_ticks, words, math.log, math.log)
    (results.FOLDER / "gaps.svg").write_text(svg)


def blocks():
    """The page's blocks by name, and the figures."""
    scores = Scores(results.BODIES.read())
    if not scores.having("interslice", "SDF PCHIP"):
        raise SystemExit(f"{results.BODIES.path}: no body has both interslice and SDF PCHIP")
    gaps(scores)
    return {f.__name__: f(scores) for f in (headline, ahead, groups, behind, reliability, hold_outs)}


def compare(rows, again):
    """Says whether the means of other bodies agree with those of results.csv: 0 lies in the interval of their difference."""
    scores, fresh = Scores(rows), Scores(again)
    outside = total = 0
    for program in fresh.programs:
        for measure in ("dice", "distance", "distance95", "volume", "crease"):
            sets = [s.of(s.having(program), program, measure) for s in (scores, fresh)]
            if min(map(len, sets)) < 10:
                continue
            rng, draws = np.random.default_rng(0), []
            for values in sets:
                draws.append(values[rng.integers(len(values), size=(statistics.RESAMPLES, len(values)))].mean(1))
            low, high = np.percentile(draws[1] - draws[0], (2.5, 97.5))
            within = low <= 0 <= high
            total, outside = total + 1, outside + (not within)
            found = "agree" if within else "DIFFER"
            print(f"{program}, {measure}: {sets[0].mean():.4g} of {len(sets[0])} bodies, {sets[1].mean():.4g} of {len(sets[1])}: {found}")
    if total == 0:
        raise SystemExit("ten bodies at least are needed to compare")
    print(f"{total - outside} of {total} means agree within 95 %; one of twenty may differ by chance, and the measures of a body are not independent")
    if outside > max(total // 4, 1):
        raise SystemExit("too many differ")
