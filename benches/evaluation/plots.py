"""Figures as SVG: lines with intervals on two axes. Numbers have a tenth of a pixel, so that files stay small."""

from dataclasses import dataclass, field
from html import escape

WIDTH, HEIGHT = 680, 420
LEFT, RIGHT, TOP, BOTTOM = 64, 216, 16, 52
COLOURS = ("#c2410c", "#1d4ed8", "#0f766e", "#7c3aed", "#a16207", "#be185d", "#475569", "#65a30d")


@dataclass
class Line:
    """Points (x, y), with the ends of the interval of y where there are any."""

    name: str
    x: list
    y: list
    low: list = field(default_factory=list)
    high: list = field(default_factory=list)
    dashed: bool = False


def axis(scale, low, high, start, end):
    """Place in the figure of a value between `low` and `high`, after `scale`."""
    a, b = scale(low), scale(high)
    return lambda value: start + (end - start) * (min(max(scale(value), min(a, b)), max(a, b)) - a) / (b - a)


def figure(title, lines, x, y, x_ticks, y_ticks, words, x_scale=float, y_scale=float):
    """An SVG. `x` and `y` are the ends of the axes; ticks are (value, word); `words` name the axes."""
    across, up = axis(x_scale, *x, LEFT, WIDTH - RIGHT), axis(y_scale, *y, HEIGHT - BOTTOM, TOP)
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12" role="img">',
        f'<title>{escape(title)}</title><rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
    ]
    for value, word in x_ticks:
        out.append(f'<path d="M{across(value):.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#e2e2e2"/>')
        out.append(f'<text x="{across(value):.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{escape(word)}</text>')
    for value, word in y_ticks:
        out.append(f'<path d="M{LEFT} {up(value):.1f}H{WIDTH - RIGHT}" stroke="#e2e2e2"/>')
        out.append(f'<text x="{LEFT - 6}" y="{up(value) + 4:.1f}" text-anchor="end">{escape(word)}</text>')
    out.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2:.0f}" y="{HEIGHT - 14}" text-anchor="middle">{escape(words[0])}</text>')
    out.append(f'<text transform="translate(14 {(TOP + HEIGHT - BOTTOM) / 2:.0f}) rotate(-90)" text-anchor="middle">{escape(words[1])}</text>')
    for k, line in enumerate(lines):
        colour = COLOURS[k % len(COLOURS)]
        way = "L".join(f"{across(a):.1f} {up(b):.1f}" for a, b in zip(line.x, line.y))
        dash = ' stroke-dasharray="5 4"' if line.dashed else ""
        out.append(f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="1.8"{dash}/>')
        for a, low, high in zip(line.x, line.low, line.high):
            out.append(f'<path d="M{across(a):.1f} {up(low):.1f}V{up(high):.1f}" stroke="{colour}"/>')
        if not line.dashed:
            out += [f'<circle cx="{across(a):.1f}" cy="{up(b):.1f}" r="2.6" fill="{colour}"/>' for a, b in zip(line.x, line.y)]
        place = TOP + 10 + 18 * k
        out.append(f'<path d="M{WIDTH - RIGHT + 12} {place}h20" stroke="{colour}" stroke-width="2"{dash}/>')
        out.append(f'<text x="{WIDTH - RIGHT + 38}" y="{place + 4}">{escape(line.name)}</text>')
    return "\n".join([*out, "</svg>\n"])
