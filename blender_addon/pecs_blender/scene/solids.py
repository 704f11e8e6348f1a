# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes from simple solids."""

import math

from mathutils import Vector

from .build import mesh_object


class Shape:
    """Vertices, faces and the material of each, put together from simple solids; then an object."""

    def __init__(self):
        self.vertices, self.faces, self.materials, self._slots = [], [], [], []

    def add(self, vertices, faces, material):
        first = len(self.vertices)
        self.vertices += [tuple(v) for v in vertices]
        self.faces += [tuple(first + i for i in face) for face in faces]
        if material not in self.materials:
            self.materials.append(material)
        self._slots += [self.materials.index(material)] * len(faces)

    def box(self, x_m, y_m, z_m, material):
        corners = [(x, y, z) for z in z_m for y in y_m for x in x_m]
        self.add(
            corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)], material
        )

    def prism(self, profile, x_m, material):
        """A profile of (y, z) points, drawn along x."""
        n = len(profile)
        corners = [(x, y, z) for x in x_m for y, z in profile]
        self.band(corners[:n], corners[n:], material)
        self.add(corners, [tuple(range(n)), tuple(range(2 * n - 1, n - 1, -1))], material)

    def band(self, low, high, material):
        """Faces between two closed rings of as many points."""
        n = len(low)
        self.add([*low, *high], [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)], material)

    def tube(self, start, end, radii_m, material, segments=12, round_ends=False):
        """A frustum; with round ends a capsule."""
        start, end = Vector(start), Vector(end)
        along = (end - start).normalized()
        u = along.orthogonal().normalized()
        v = along.cross(u)
        rings = [(start, radii_m[0]), (end, radii_m[1])]
        if round_ends:
            steps = [math.radians(a) for a in (80, 50, 25)]
            rings = [(start - along * radii_m[0] * math.sin(a), radii_m[0] * math.cos(a)) for a in steps] + rings
            rings += [(end + along * radii_m[1] * math.sin(a), radii_m[1] * math.cos(a)) for a in reversed(steps)]
        turns = [2 * math.pi * k / segments for k in range(segments)]
        points = [c + r * (math.cos(a) * u + math.sin(a) * v) for c, r in rings for a in turns]
        faces = [
            (r + k, r + (k + 1) % segments, r + segments + (k + 1) % segments, r + segments + k)
            for r in range(0, segments * (len(rings) - 1), segments)
            for k in range(segments)
        ]
        last = segments * (len(rings) - 1)
        self.add(points, [*faces, tuple(range(segments))[::-1], tuple(range(last, last + segments))], material)

    def object(self, name, kind):
        thing = mesh_object(name, self.vertices, self.faces, self.materials)
        thing.data.polygons.foreach_set("material_index", self._slots)
        thing.data.update()
        thing["pecs_class"] = kind
        return thing
