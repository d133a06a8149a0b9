#!/usr/bin/env python3
"""How the time of an iteration grows with splats and with pixels, as an SVG.

    plot_growth.py OUT.svg FILE...

FILEs are what `tvsgs-bench stages --out FILE` writes (docs/develop/performance.md, "Growth"). Runs with the same number of
pixels make the left plot, over splats; runs with the same number of splats the right one, over pixels.
"""
import collections
import json
import math
import sys

COLORS = ["#000000", "#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#888888", "#999933"]
WIDTH, HEIGHT, LEFT, TOP = 420, 320, 60, 30


def read(files):
    """Rows of (splats, pixels, {stage: median ms})."""
    rows = []
    for name in files:
        with open(name, encoding="utf-8") as file:
            for line in file:
                run = json.loads(line)
                if run.get("bench") != "stages":
                    sys.exit(f"{name}: not written by 'tvsgs-bench stages --out'")
                times = {stage["stage"]: stage["median_ms"] for stage in run["stages"]}
                rows.append((run["counters"]["splats"], run["width"] * run["height"], times))
    return rows


def commonest(values):
    return collections.Counter(values).most_common(1)[0][0]


def bounds(values):
    """Whole powers of ten, or twos and fives of them, around all values."""
    def step(value, up):
        power = 10 ** math.floor(math.log10(value))
        steps = [power * k for k in (1, 2, 5, 10)]
        return min(s for s in steps if s >= value * 0.9999) if up else max(s for s in steps if s <= value * 1.0001)
    return step(min(values), False), step(max(values), True)


def ticks(low, high):
    power = 10 ** math.floor(math.log10(low))
    while power <= high * 1.0001:
        for k in (1, 2, 5):
            if low * 0.9999 <= power * k <= high * 1.0001:
                yield power * k
        power *= 10


def number(value):
    for size, unit in ((1e6, " M"), (1e3, " k")):
        if value >= size:
            return f"{value / size:g}{unit}"
    return f"{value:g}"


def plot(points, title, offset):
    """points: [(x, {stage: ms})]; both axes logarithmic."""
    stages = list(dict.fromkeys(stage for _, times in points for stage in times))
    (x0, x1), (y0, y1) = bounds([x for x, _ in points]), bounds([t for _, times in points for t in times.values()])
    if x0 == x1:
        x1 *= 2
    def at_x(x):
        return offset + LEFT + WIDTH * math.log(x / x0) / math.log(x1 / x0)
    def at_y(y):
        return TOP + HEIGHT * (1 - math.log(y / y0) / math.log(y1 / y0))
    out = [f'<text x="{offset + LEFT + WIDTH / 2}" y="{TOP - 12}" text-anchor="middle">{title}</text>']
    for x in ticks(x0, x1):
        out.append(f'<path d="M{at_x(x):.1f} {TOP}V{TOP + HEIGHT}" class="grid"/>'
                   f'<text x="{at_x(x):.1f}" y="{TOP + HEIGHT + 16}" text-anchor="middle">{number(x)}</text>')
    for y in ticks(y0, y1):
        out.append(f'<path d="M{offset + LEFT} {at_y(y):.1f}h{WIDTH}" class="grid"/>'
                   f'<text x="{offset + LEFT - 6}" y="{at_y(y) + 4:.1f}" text-anchor="end">{y:g} ms</text>')
    for i, stage in enumerate(stages):
        line = sorted((x, times[stage]) for x, times in points if stage in times)
        path = " ".join(f"{at_x(x):.1f},{at_y(y):.1f}" for x, y in line)
        color, width = COLORS[i % len(COLORS)], 2.5 if i == 0 else 1.2
        out.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width}"/>')
        out += [f'<circle cx="{at_x(x):.1f}" cy="{at_y(y):.1f}" r="2.5" fill="{color}"/>' for x, y in line]
        out.append(f'<text x="{offset + LEFT + WIDTH + 8}" y="{TOP + 14 + 17 * i}" fill="{color}">{stage}</text>')
    return out


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__.strip())
    rows = read(sys.argv[2:])
    pixels, splats = commonest([row[1] for row in rows]), commonest([row[0] for row in rows])
    panels = [(f"{number(pixels)} pixels, over splats", [(s, t) for s, p, t in rows if p == pixels]),
              (f"{number(splats)} splats, over pixels", [(p, t) for s, p, t in rows if s == splats])]
    panels = [(title, points) for title, points in panels if len({x for x, _ in points}) > 1]
    if not panels:
        sys.exit("no two runs that differ in their splats or in their pixels only")
    width = len(panels) * (LEFT + WIDTH + 180)
    body = [line for i, (title, points) in enumerate(panels) for line in plot(points, title, i * (LEFT + WIDTH + 180))]
    with open(sys.argv[1], "w", encoding="utf-8") as file:
        file.write(f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{TOP + HEIGHT + 30}" '
                   'font-family="sans-serif" font-size="12"><style>.grid{stroke:#ddd;fill:none}</style>'
                   '<rect width="100%" height="100%" fill="#fff"/>' + "\n".join(body) + "</svg>\n")


if __name__ == "__main__":
    main()
