"""Reads a pattern with ezdxf and CairoSVG: exit 1 with a sentence if either finds a fault or they disagree.

    python check_pattern.py pattern.svg pattern.dxf
"""
import collections
import math
import sys
import xml.etree.ElementTree as ElementTree

import cairosvg
import ezdxf
import numpy as np

SVG = "{http://www.w3.org/2000/svg}"


def length(points, is_closed):
    points = np.asarray(points + points[:1] if is_closed else points)
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


def svg_lines(path):
    """Width and height in mm, lines and texts of each layer, y up."""
    root = ElementTree.parse(path).getroot()
    size = [float(root.get(side).removesuffix("mm")) for side in ("width", "height")]
    assert [float(x) for x in root.get("viewBox").split()] == [0, 0, *size], "a unit is not one mm"
    lines, texts = collections.defaultdict(list), collections.defaultdict(list)
    for group in root.iter(SVG + "g"):
        for path in group.iter(SVG + "path"):
            for piece in path.get("d").split("M")[1:]:
                points = [[float(x) for x in at.split()] for at in piece.rstrip("Z").split("L")]
                lines[group.get("id")].append(([[x, size[1] - y] for x, y in points], piece.endswith("Z")))
        texts[group.get("id")] += [text.text for text in group.iter(SVG + "text")]
    return size, lines, texts


def main(svg, dxf):
    drawing = ezdxf.readfile(dxf)
    audit = drawing.audit()
    if audit.errors or audit.fixes:
        return f"ezdxf: {[error.message for error in audit.errors + audit.fixes]}"
    if drawing.dxfversion != "AC1009" or drawing.header["$INSUNITS"] != 4:
        return "it is not of Release 12 in mm"
    size, lines, texts = svg_lines(svg)
    space = drawing.modelspace()
    for layer in ("CUT", "SEAM", "TEXT"):
        found = [
            ([list(at)[:2] for at in line.points()], bool(line.is_closed))
            for line in space.query(f'POLYLINE[layer=="{layer}"]')
        ]
        if [is_closed for _, is_closed in found] != [is_closed for _, is_closed in lines[layer]]:
            return f"other lines on {layer}"
        for (a, is_closed), (b, _) in zip(found, lines[layer]):
            if np.abs(np.array(a) - np.array(b)).max() > 3e-4:
                return f"a line on {layer} lies elsewhere"
        print(layer, len(found), "lines,", round(sum(length(*line) for line in found), 2), "mm")
    for layer in ("TAXEL", "TEXT"):
        found = [text.plain_text() for text in space.query(f'TEXT[layer=="{layer}"]')]
        if found != texts[layer]:
            return f"other texts on {layer}"
    if len(space.query('POINT[layer=="TAXEL"]')) != len(texts["TAXEL"]):
        return "not every taxel has its id"
    if not any(math.isclose(length(*line), 50.0) for line in lines["TEXT"]):
        return "no bar of 50 mm"
    # A picture of 2 pixels a mm; CSS has 96 pixels an inch.
    picture = cairosvg.svg2png(url=svg, scale=2 * 25.4 / 96, background_color="white")
    width, height = (int.from_bytes(picture[k : k + 4], "big") for k in (16, 20))
    if abs(width - 2 * size[0]) > 1.5 or abs(height - 2 * size[1]) > 1.5:
        return f"CairoSVG draws {width} x {height} pixels, not twice {size} mm"
    return None


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
