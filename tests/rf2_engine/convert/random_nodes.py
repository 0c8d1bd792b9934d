# SPDX-License-Identifier: GPL-3.0-or-later
"""Node trees that nobody would build: any node of the running Blender, any values, linked at random."""
import bpy

MOST_NODES = 12
DEEPEST = 2  # groups in groups
ODD = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-30, -1e-7, 1e6, -1e9, 3e38, float("inf"), float("-inf"), float("nan"))
ABSTRACT = {"ShaderNode", "ShaderNodeTree", "ShaderNodeCustomGroup"}  # Blender crashes when asked for one
KEPT = {"name", "label", "location", "width", "height", "parent", "select", "mute", "hide", "color", "use_custom_color",
        "show_options", "show_preview", "show_texture", "location_absolute", "node_tree", "color_tag",
        "warning_propagation"}


def node_types() -> list[str]:
    """Identifiers of all shader nodes that a script can add."""
    tree, usable = bpy.data.node_groups.new("Probe", "ShaderNodeTree"), ["NodeReroute", "NodeFrame"]
    for name in sorted(dir(bpy.types)):
        if name.startswith("ShaderNode") and name not in ABSTRACT:
            try:
                usable.append(tree.nodes.new(name).bl_idname)
            except RuntimeError:
                pass  # for another kind of tree
    bpy.data.node_groups.remove(tree)
    return usable


def number(rng) -> float:
    """Mostly of the usual size."""
    kind = rng.random()
    if kind < 0.15:
        return ODD[rng.integers(len(ODD))]
    return float(rng.normal() * 10 ** rng.uniform(-3, 3)) if kind < 0.3 else float(rng.random())


def fill(tree, rng, types, depth=0) -> None:
    """Replace what is in a tree; the tree's own kind of output comes with it."""
    tree.nodes.clear()
    for name in rng.choice(types, rng.integers(1, MOST_NODES)):
        _randomize(tree.nodes.new(str(name)), rng, types, depth)
    for _ in range(rng.integers(0, 2 * len(tree.nodes) + 1)):
        _link(tree, rng)


def fill_with_output(tree, rng, types, output="ShaderNodeOutputMaterial") -> None:
    """As `fill`, with one or two outputs that are fed."""
    fill(tree, rng, types)
    for _ in range(rng.integers(1, 3)):
        end = tree.nodes.new(output)
        end.target = rng.choice(["ALL", "CYCLES", "EEVEE"], p=[0.7, 0.2, 0.1])
        shaders = [socket for node in tree.nodes for socket in node.outputs if socket.type == "SHADER"]
        if not shaders or rng.random() < 0.3:
            shaders = [tree.nodes.new("ShaderNodeBsdfPrincipled").outputs[0]]
            _values(tree.nodes[-1].inputs, rng)
            for socket in tree.nodes[-1].inputs:
                if rng.random() < 0.3:
                    _feed(tree, socket, rng)
        for socket in end.inputs:
            if rng.random() < 0.9 - 0.5 * (socket.name != "Surface"):
                tree.links.new(shaders[rng.integers(len(shaders))], socket)
            elif rng.random() < 0.3:
                _feed(tree, socket, rng)


def _randomize(node, rng, types, depth) -> None:
    if node.bl_idname == "ShaderNodeGroup" and depth < DEEPEST:
        node.node_tree = _group(rng, types, depth + 1)
    for prop in node.bl_rna.properties:
        if not prop.is_readonly and not prop.identifier.startswith("bl_") and prop.identifier not in KEPT:
            if rng.random() < 0.5:
                _set(node, prop, rng)
    if ramp := getattr(node, "color_ramp", None):
        for _ in range(rng.integers(0, 4)):
            ramp.elements.new(float(rng.random())).color = [number(rng) for _ in range(4)]
        ramp.interpolation = rng.choice(["LINEAR", "EASE", "CONSTANT", "CARDINAL", "B_SPLINE"])
    if mapping := getattr(node, "mapping", None):
        for curve in getattr(mapping, "curves", ()):
            curve.points.new(float(rng.random()), float(rng.random()))
        if hasattr(mapping, "update"):
            mapping.update()
    _values(node.inputs, rng)
    _values(node.outputs, rng)
    node.mute = bool(rng.random() < 0.1)


def _set(node, prop, rng) -> None:
    if prop.type == "ENUM":
        options = [item.identifier for item in prop.enum_items_static] or [prop.default]
        value = set(options[:rng.integers(len(options) + 1)]) if prop.is_enum_flag else str(rng.choice(options))
    elif prop.type in ("FLOAT", "INT"):
        numbers = [number(rng) for _ in range(max(prop.array_length, 1))]
        if prop.type == "INT":
            numbers = [int(x) if abs(x) < 2**31 else 0 for x in numbers]
        value = numbers if prop.is_array else numbers[0]
    elif prop.type == "BOOLEAN":
        value = bool(rng.random() < 0.5)
    elif prop.type == "STRING":
        value = str(rng.choice(["", "UVMap", "Color", "density", "no such thing"]))
    elif prop.type == "POINTER":
        blocks = {"Image": bpy.data.images, "Object": bpy.data.objects, "Text": bpy.data.texts}.get(
            prop.fixed_type.identifier, ())
        value = blocks[rng.integers(len(blocks))] if len(blocks) else None
    else:
        return
    try:
        setattr(node, prop.identifier, value)
    except (TypeError, ValueError, AttributeError, RuntimeError, OverflowError):
        pass  # Blender does not allow it


def _values(sockets, rng) -> None:
    for socket in sockets:
        value = getattr(socket, "default_value", None)
        if rng.random() < 0.5 or isinstance(value, (str, bool, bpy.types.ID)):
            continue
        try:
            if isinstance(value, int):
                socket.default_value = int(rng.integers(-100, 100))
            elif isinstance(value, float):
                socket.default_value = number(rng)
            elif value is not None:
                socket.default_value = [number(rng) for _ in value]
        except (TypeError, ValueError):
            pass


def _link(tree, rng) -> None:
    nodes = tree.nodes
    first, second = nodes[rng.integers(len(nodes))], nodes[rng.integers(len(nodes))]
    if len(first.outputs) and len(second.inputs):
        link = tree.links.new(first.outputs[rng.integers(len(first.outputs))],
                              second.inputs[rng.integers(len(second.inputs))])
        if link and rng.random() < 0.05:
            link.is_muted = True


def _feed(tree, socket, rng) -> None:
    outputs = [output for node in tree.nodes for output in node.outputs if node != socket.node]
    if outputs:
        tree.links.new(outputs[rng.integers(len(outputs))], socket)


def _group(rng, types, depth):
    group = bpy.data.node_groups.new("Group", "ShaderNodeTree")
    kinds = ["NodeSocketFloat", "NodeSocketColor", "NodeSocketVector", "NodeSocketShader", "NodeSocketInt"]
    for direction in ("INPUT", "OUTPUT"):
        for i in range(rng.integers(0, 4)):
            group.interface.new_socket(f"{direction} {i}", in_out=direction, socket_type=str(rng.choice(kinds)))
    fill(group, rng, types, depth)
    group.nodes.new("NodeGroupInput")
    end = group.nodes.new("NodeGroupOutput")
    for socket in end.inputs:
        if socket.enabled and rng.random() < 0.8:
            _feed(group, socket, rng)
    for _ in range(4):
        _link(group, rng)
    return group
