# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes that nobody would build: objects of all kinds, odd shapes, transforms, modifiers, parents and instances."""
import bpy

from tests.rf2_engine.convert.random_nodes import number

from . import random_nodes

MODIFIERS = {  # and what keeps their work small; without simulations and Skin, in which Blender itself may crash
    "ARRAY": {"count": 4}, "BEVEL": {"segments": 2}, "BOOLEAN": {}, "BUILD": {}, "CAST": {}, "CURVE": {},
    "DECIMATE": {}, "DISPLACE": {}, "EDGE_SPLIT": {}, "HOOK": {}, "LATTICE": {}, "MASK": {}, "MIRROR": {},
    "MULTIRES": {}, "NORMAL_EDIT": {}, "OCEAN": {"resolution": 2, "viewport_resolution": 2}, "SHRINKWRAP": {},
    "SIMPLE_DEFORM": {}, "SCREW": {"steps": 4, "render_steps": 4, "iterations": 1}, "SMOOTH": {}, "SOLIDIFY": {},
    "SUBSURF": {"levels": 1}, "TRIANGULATE": {}, "UV_PROJECT": {}, "WAVE": {}, "WEIGHTED_NORMAL": {}, "WELD": {},
    "WIREFRAME": {}, "PARTICLE_INSTANCE": {}, "FLUID": {},
}
TARGETS = ("object", "target", "mirror_object", "origin", "object_offset", "start_position_object")
RAYS = ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")
MOST_OBJECTS = 10


class RandomScene:
    """Fills an empty scene from one source of random numbers."""

    def __init__(self, scene, rng, types):
        self.scene, self.rng, self.types = scene, rng, types
        self.collections = [scene.collection]
        for i in range(rng.integers(0, 3)):
            made = bpy.data.collections.new(f"Collection {i}")
            self.some(self.collections).children.link(made)
            self.collections.append(made)
        self.materials = [None, *(self._material() for _ in range(rng.integers(0, 3)))]
        self.objects = []
        for _ in range(rng.integers(0, MOST_OBJECTS)):
            self._add()
        for obj in self.objects:
            self._arrange(obj)
        self._camera()
        if rng.random() < 0.2:
            scene.world = bpy.data.worlds.new("Random")
            scene.world.use_nodes = True
            random_nodes.fill_with_output(scene.world.node_tree, rng, types, "ShaderNodeOutputWorld")

    def some(self, things):
        return things[self.rng.integers(len(things))]

    def chance(self, share) -> bool:
        return bool(self.rng.random() < share)

    def _material(self):
        made = bpy.data.materials.new("Material")
        made.use_nodes = self.chance(0.9)
        if made.use_nodes and self.chance(0.7):
            random_nodes.fill_with_output(made.node_tree, self.rng, self.types)
        elif made.use_nodes and self.chance(0.3):
            made.node_tree.nodes.clear()
        return made

    def _add(self) -> None:
        make = self.some([self._mesh] * 5 + [self._lamp] * 2 + [self._curve, self._text, self._ball, self._surface,
                                                                self._other])
        data = make()
        obj = bpy.data.objects.new("Object", data)
        self.objects.append(obj)
        self.some(self.collections).objects.link(obj)
        if hasattr(data, "materials") and data.materials is not None:
            for _ in range(self.rng.integers(0, 3)):
                data.materials.append(self.some(self.materials))

    def _mesh(self):
        if self.chance(0.15) and bpy.data.meshes:
            return self.some(bpy.data.meshes)
        mesh, count = bpy.data.meshes.new("Mesh"), int(self.rng.integers(0, 30))
        place = self.rng.normal(size=(count, 3)) * 10 ** self.rng.uniform(-2, 2)
        if self.chance(0.2):
            place = [[number(self.rng) for _ in range(3)] for _ in range(count)]
        corners = [list(map(int, self.rng.permutation(count)[:self.rng.integers(3, 6)])) for _ in range(count)]
        faces = [face for face in corners if len(face) > 2] if self.chance(0.9) else []
        edges = [(i, i + 1) for i in range(count - 1)] if not faces else []
        mesh.from_pydata(place, edges, faces)
        for i in range(self.rng.integers(0, 3)):
            mesh.uv_layers.new(name=f"UV {i}")
            mesh.color_attributes.new(f"Color {i}", "FLOAT_COLOR", self.some(["POINT", "CORNER"]))
        for polygon in mesh.polygons:
            polygon.use_smooth, polygon.material_index = self.chance(0.5), int(self.rng.integers(0, 4))
        if self.chance(0.5):
            mesh.validate()
        return mesh

    def _lamp(self):
        lamp = bpy.data.lights.new("Lamp", self.some(["POINT", "SUN", "SPOT", "AREA"]))
        for name in ("energy", "exposure", "shadow_soft_size", "angle", "spot_size", "spot_blend", "size", "size_y",
                     "spread", "temperature"):
            if hasattr(lamp, name) and self.chance(0.5):
                setattr(lamp, name, number(self.rng))
        lamp.color = [number(self.rng) for _ in range(3)]
        if lamp.type == "AREA":
            lamp.shape = self.some(["SQUARE", "RECTANGLE", "DISK", "ELLIPSE"])
            lamp.cycles.is_portal = self.chance(0.1)
        if self.chance(0.2):
            lamp.use_nodes = True
            random_nodes.fill_with_output(lamp.node_tree, self.rng, self.types, "ShaderNodeOutputLight")
        return lamp

    def _curve(self):
        curve = bpy.data.curves.new("Curve", "CURVE")
        curve.dimensions, curve.bevel_depth = self.some(["2D", "3D"]), self.some([0, 0.1, -1, 1e9])
        spline = curve.splines.new(self.some(["POLY", "NURBS", "BEZIER"]))
        points = spline.bezier_points if spline.type == "BEZIER" else spline.points
        points.add(int(self.rng.integers(0, 5)))
        for point in points:
            point.co[:3] = [number(self.rng) for _ in range(3)]
        return curve

    def _surface(self):
        made = bpy.data.curves.new("Surface", "SURFACE")
        made.splines.new("NURBS").points.add(3)
        return made

    def _text(self):
        text = bpy.data.curves.new("Text", "FONT")
        text.body, text.extrude, text.size = self.some(["", "a", "\u00e9\n"]), self.some([0, 0.1]), self.some([0, 1])
        return text

    def _ball(self):
        balls = bpy.data.metaballs.new("Ball")
        balls.resolution = balls.render_resolution = 1.0
        for _ in range(self.rng.integers(0, 3)):
            balls.elements.new(type=self.some(["BALL", "CUBE", "PLANE"])).radius = self.some([0, 1, 2])
        return balls

    def _other(self):
        kinds = ["volumes", "hair_curves", "pointclouds", "lattices", "armatures", "lightprobes", "speakers", "cameras"]
        kind = self.some([name for name in kinds if hasattr(bpy.data, name)] + [None, None])
        holder = kind and getattr(bpy.data, kind)
        if holder is None:
            return None  # an empty
        return holder.new("Probe", "SPHERE") if kind == "lightprobes" else holder.new("Data")

    def _arrange(self, obj) -> None:
        rng = self.rng
        obj.location, obj.rotation_euler = rng.normal(size=3) * 3, rng.normal(size=3)
        if self.chance(0.3):
            obj.scale = [self.some([0, 1, -1, 1e-6, 1e6, 2]) for _ in range(3)]
        if self.chance(0.1):
            obj.location = [number(rng) for _ in range(3)]
        if self.chance(0.2):
            other = self.some(self.objects)  # Blender refuses longer loops by itself
            obj.parent = None if other == obj else other
            obj.matrix_parent_inverse[0][1] = number(rng)
        if self.chance(0.3):
            obj.instance_type = self.some(["NONE", "VERTS", "FACES"] if obj.type == "MESH" else ["NONE"])
        if obj.type == "EMPTY" and len(self.collections) > 1:
            obj.instance_type, obj.instance_collection = "COLLECTION", self.some(self.collections[1:])
        for ray in RAYS:
            setattr(obj, f"visible_{ray}", self.chance(0.9))
        obj.is_shadow_catcher, obj.is_holdout, obj.hide_render = (self.chance(0.05) for _ in range(3))
        if self.chance(0.1):
            obj.light_linking.receiver_collection = self.some(self.collections)
        if self.chance(0.1) and obj.material_slots:
            obj.material_slots[0].link, obj.material_slots[0].material = "OBJECT", self.some(self.materials)
        if obj.type in ("MESH", "CURVE", "FONT", "SURFACE") and self.chance(0.6):
            if obj.type == "MESH":
                obj.data.validate()  # modifiers of Blender crash over faces with a corner twice
            for _ in range(rng.integers(1, 3)):
                self._modify(obj)
        if obj.type == "MESH" and self.chance(0.1):
            obj.data.validate()
            self._particles(obj)
        if self.chance(0.1):
            obj.constraints.new(self.some(["COPY_LOCATION", "TRACK_TO", "CHILD_OF"])).target = self.some(self.objects)

    def _modify(self, obj) -> None:
        kind = self.some(list(MODIFIERS))
        modifier = obj.modifiers.new(kind, kind)
        if modifier is None:
            return  # not for objects of this type
        for name, value in MODIFIERS[kind].items():
            if hasattr(modifier, name):
                setattr(modifier, name, value)
        for name in TARGETS:
            try:
                setattr(modifier, name, self.some(self.objects))
            except (TypeError, AttributeError):
                pass
        if kind == "FLUID":
            modifier.fluid_type = self.some(["NONE", "DOMAIN", "FLOW"])

    def _particles(self, obj) -> None:
        settings = obj.modifiers.new("Particles", "PARTICLE_SYSTEM").particle_system.settings
        settings.type, settings.count = self.some(["EMITTER", "HAIR"]), 5
        settings.render_type = self.some(["PATH", "OBJECT", "COLLECTION", "NONE"])
        settings.instance_object, settings.instance_collection = self.some(self.objects), self.some(self.collections)

    def _camera(self) -> None:
        camera = self.scene.camera.data
        camera.type = self.some(["PERSP"] * 3 + ["ORTHO", "PANO"])
        camera.lens, camera.ortho_scale = self.some([50, 1, 5000]), self.some([6, 1e-3, 1e6])
        camera.clip_start, camera.shift_x = self.some([0.1, 1e-6, 1e3]), self.some([0, 0.5, -10])
        self.scene.camera.matrix_world[0][3] = self.some([0, 0, 1e6, float("nan")])
