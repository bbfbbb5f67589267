"""The shapes of BENCHMARKS.md as (V, F): vertices in metres and triangles, at any number of triangles.

cap: a spherical cap of 110 degrees. dense: the same with a spacing that varies about 80-fold.
forearm: 300 degrees of a tapered, bumpy tube with three holes. saddle: strongly curved both ways.
ball: a closed, bumpy sphere.
"""
import numpy as np
from scipy.spatial import ConvexHull, Delaunay


def lattice(width, height, step, rng):
    """Points of a triangular lattice, moved at random by up to 0.12 steps."""
    rows = np.arange(int(height / (step * np.sqrt(3) / 2)) + 1)
    x, row = np.meshgrid(np.arange(int(width / step) + 1) * step, rows)
    points = np.column_stack([(x + row % 2 * step / 2).ravel(), (row * step * np.sqrt(3) / 2).ravel()])
    return points + rng.uniform(-0.12, 0.12, points.shape) * step


def triangulate(points, keep=None):
    """Delaunay triangles, counterclockwise, without slivers on the hull; `keep` selects by centroid."""
    faces = Delaunay(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces[doubled < 0] = faces[doubled < 0][:, ::-1]
    good = np.abs(doubled) > 1e-3 * np.median(np.abs(doubled)) if keep else np.abs(doubled) > 1e-14
    if keep:
        good &= keep(points[faces].mean(axis=1))
    return faces[good]


def compact(vertices, faces):
    """Drops vertices that no triangle uses."""
    used, faces = np.unique(faces, return_inverse=True)
    return np.ascontiguousarray(vertices[used]), np.ascontiguousarray(faces.reshape(-1, 3))


def cap(triangles, radius=0.1, half_angle=np.radians(110), moebius=0.0):
    """Rings on the sphere, triangulated in stereographic projection, where circles stay circles.

    A Moebius transformation of that plane concentrates the points: the spacing varies by ((1 + m)/(1 - m))^2.
    """
    rng = np.random.default_rng(1)
    step = np.sqrt(2 * np.pi * (1 - np.cos(half_angle)) / triangles * 4 / np.sqrt(3))
    rings = max(2, round(half_angle / (step * np.sqrt(3) / 2)))
    points = [np.zeros(1, complex)]
    for k in range(1, rings + 1):
        polar = half_angle * k / rings
        count = max(6, round(2 * np.pi * np.sin(polar) / step))
        turn = 2 * np.pi * (np.arange(count) + k % 2 / 2) / count
        move = rng.uniform(-0.15, 0.15, (2, count)) * step * (k < rings)
        polar = polar + move[0]
        turn = turn + move[1] / max(np.sin(half_angle * k / rings), 0.05)
        points.append(np.tan(polar / 2) / np.tan(half_angle / 2) * np.exp(1j * turn))
    rim = len(points[-1])
    z = np.concatenate(points)
    z = (z + moebius) / (1 + moebius * z)
    z[-rim:] /= np.abs(z[-rim:])
    plane = np.column_stack([z.real, z.imag])
    faces = triangulate(plane)
    w = plane * np.tan(half_angle / 2)
    squared = (w**2).sum(axis=1)[:, None]
    return compact(radius * np.column_stack([2 * w, squared - 1]) / (1 + squared), faces)


def dense(triangles):
    return cap(triangles, moebius=0.7)


def forearm(triangles):
    rng = np.random.default_rng(2)
    length, sector, radius = 0.25, np.radians(300), 0.045
    width = radius * sector
    step = np.sqrt(width * length / triangles * 4 / np.sqrt(3))
    holes = [(0.25, 0.3, 0.018), (0.6, 0.6, 0.025), (0.75, 0.2, 0.012)]
    holes = [(np.array([u * width, v * length]), r) for u, v, r in holes]
    across, along = np.linspace(0, width, int(width / step) + 1), np.linspace(0, length, int(length / step) + 1)
    border = [np.column_stack([across, np.full(len(across), y)]) for y in (0, length)]
    border += [np.column_stack([np.full(len(along) - 2, x), along[1:-1]]) for x in (0, width)]
    points = lattice(width, length, step, rng)
    points = points[((points > 0.5 * step) & (points < np.array([width, length]) - 0.5 * step)).all(axis=1)]
    for centre, r in holes:
        points = points[np.hypot(*(points - centre).T) > r + 0.6 * step]
        turn = 2 * np.pi * np.arange(max(8, int(2 * np.pi * r / step))) / max(8, int(2 * np.pi * r / step))
        border.append(centre + r * np.column_stack([np.cos(turn), np.sin(turn)]))
    points = np.concatenate([points, *border])
    inside = lambda c: np.all([np.hypot(*(c - centre).T) > 0.99 * r * np.cos(step / (2 * r)) for centre, r in holes], axis=0)
    faces = triangulate(points, inside)
    u, v = points.T / np.array([[width], [length]])
    r = radius * (1.15 - 0.45 * v)
    for bu, bv, s, height in [(0.5, 0.25, 0.08, 0.01), (0.2, 0.7, 0.06, 0.012), (0.85, 0.55, 0.07, -0.008),
                              (0.45, 0.85, 0.07, 0.009), (0.9, 0.9, 0.05, 0.008)]:
        r = r + height * np.exp(-((u - bu) ** 2 + (0.8 * (v - bv)) ** 2) / (2 * s * s))
    turn = sector * (u - 0.5)
    return compact(np.column_stack([r * np.cos(turn), r * np.sin(turn), points[:, 1]]), faces)


def saddle(triangles):
    rng = np.random.default_rng(3)
    step = np.sqrt(np.pi / triangles * 4 / np.sqrt(3))
    points = lattice(2, 2, step, rng) - 1
    turn = 2 * np.pi * np.arange(int(2 * np.pi / step)) / int(2 * np.pi / step)
    points = np.concatenate([points[np.hypot(*points.T) < 1 - 0.6 * step], np.column_stack([np.cos(turn), np.sin(turn)])])
    faces = triangulate(points)
    x, y = points.T
    z = 0.55 * (x * x - y * y) + 0.25 * (x**3 - 3 * x * y * y)
    for bx, by, s, height in [(0, 0, 0.16, 0.55), (0.5, 0.3, 0.13, -0.45), (-0.5, 0.35, 0.12, 0.45),
                              (-0.2, -0.55, 0.13, 0.5), (0.45, -0.4, 0.1, -0.35)]:
        z = z + height * np.exp(-((x - bx) ** 2 + (y - by) ** 2) / (2 * s * s))
    return compact(0.1 * np.column_stack([x, y, z]), faces)


def ball(triangles):
    """Points of a Fibonacci spiral, and their convex hull before the bumps."""
    count = triangles // 2 + 2
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(count)
    points = np.column_stack([np.sqrt(1 - z * z)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]), z])
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = (np.cross(b - a, c - a) * a).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    bumps = 1 + 0.1 * np.sin(5 * points[:, 0]) * np.cos(4 * points[:, 1])
    return 0.1 * points * bumps[:, None], faces


SHAPES = {"cap": cap, "forearm": forearm, "saddle": saddle, "dense": dense, "ball": ball}


def write_obj(path, vertices, faces):
    with open(path, "w") as file:
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist())
