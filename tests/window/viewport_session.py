# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user does in a Rendered viewport: `blender --python viewport_session.py -- ZIP FOLDER [drag]`.

Writes seconds until pictures of our viewport and of Cycles' with denoising to FOLDER/viewport.csv; with `drag` only how
often the window is drawn while an object is dragged, as in small windows, which a processor draws quickly.
"""
import csv
import sys
import time
from pathlib import Path

import bpy

sys.path.append(str(Path(__file__).parent))
from driver import Driver, area, is_rendering, region  # noqa: E402  it lies beside this file

ARCHIVE, FOLDER, *PARTS = map(Path, sys.argv[sys.argv.index("--") + 1:])
EXTENSION = "bl_ext.user_default.renderformer_v2"
TICK = 0.01     # seconds between two looks at whether the window stands still
PICTURES = 3    # that are to be seen during a drag
QUIET = 3.0     # seconds without a redraw after which Cycles' picture counts as finished
SAMPLES = 32    # of Cycles' viewport
DRAG = 5.0      # seconds that an object is dragged

COLUMNS = "engine", "change", "first", "last", "stall", "pictures", "redraws"

driver = Driver(FOLDER)
found = driver.found
window = {"last": 0.0, "stall": 0.0, "draws": [], "shown": [], "before": None, "begin": 0.0, "clock": False}


def session():
    bpy.ops.extensions.package_install_files(filepath=str(ARCHIVE), repo="user_default", enable_on_install=True)
    bpy.context.preferences.view.smooth_view = 0
    bpy.app.timers.register(tick, persistent=True)
    bpy.types.SpaceView3D.draw_handler_add(count_draw, (), "WINDOW", "POST_PIXEL")
    prepare()
    yield 1.0
    yield from enter()
    if PARTS:
        yield from drag(rows := [])
        write(rows)
        return
    yield from look_around()
    yield from edit()
    yield from measure()
    yield from several()
    yield from misuse()
    yield from render()
    yield from leave()


def tick() -> float:
    now = time.perf_counter()
    window["stall"], window["last"] = max(window["stall"], now - window["last"] - TICK), now
    if window["clock"] and (alive := works()) and alive[0].displayed not in (None, window["before"]):
        window["before"] = alive[0].displayed
        window["shown"].append((now, window["before"].divisor))
    return TICK


def works() -> list:
    """The sessions of the viewports that there are."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.runtime.worker import worker
    return [work for work in worker.works() if not work.closed]


def done() -> bool:
    return bool(works()) and all(work.request and not work.has_work() and not work.activity for work in works())


def count_draw() -> None:
    window["draws"].append(time.perf_counter())


def redrawn():
    before = len(window["draws"])
    area("VIEW_3D").tag_redraw()
    return lambda: len(window["draws"]) > before


def settled():
    """Until the finest pictures are on the screen."""
    yield redrawn()  # so that it was asked for them
    while not done():
        yield done
        yield redrawn()
    yield 0.2


def shown():
    return works()[0].displayed


def viewport():
    return area("VIEW_3D").spaces.active


def call(operator, **settings):
    of = area("VIEW_3D")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=of, region=region(of)):
        operator(**settings)


def prepare() -> None:
    """The cube that Blender starts with, on a floor, in a small picture."""
    scene = bpy.context.scene
    scene.render.engine = "RENDERFORMER_V2"
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    scene.renderformer_v2.guide_samples, scene.renderformer_v2.precision = 2, "fp32"
    scene.renderformer_v2.viewport.resolution, scene.renderformer_v2.viewport.time_limit = "4", 0
    bpy.ops.mesh.primitive_plane_add(size=12, location=(0, 0, -1))
    for other in bpy.context.window_manager.windows[0].screen.areas:
        if other.type == "DOPESHEET_EDITOR":
            other.type = "CONSOLE"


def enter():
    begin = window["last"] = time.perf_counter()
    window["stall"] = 0.0
    viewport().shading.type = "RENDERED"
    yield lambda: works() and shown()
    found["first_picture"] = time.perf_counter() - begin
    yield from settled()
    found["entered"] = [viewport().shading.type, shown().divisor, shown().triangles]
    driver.shot("entered")


def look_around():
    before = shown()
    call(bpy.ops.view3d.view_orbit, angle=0.5, type="ORBITLEFT")
    yield from settled()
    found["orbited"] = [shown().request.view != before.request.view, shown().request.state == before.request.state]
    driver.shot("orbited")
    call(bpy.ops.view3d.view_camera)
    yield from settled()
    driver.shot("camera")
    call(bpy.ops.view3d.view_axis, type="TOP")
    yield from settled()
    found["orthographic"] = shown().request.view.is_orthographic
    driver.shot("orthographic")
    call(bpy.ops.view3d.view_camera)
    yield from settled()


def edit():
    cube, seen = bpy.data.objects["Cube"], [shown()]
    window["stall"] = 0.0
    while len(seen) <= PICTURES:
        cube.location.x += 0.1 if cube.location.x < 0 else -0.7
        yield 0.1
        if shown() is not seen[-1]:
            seen.append(shown())
    found["dragged"] = len({picture.request.state for picture in seen})
    yield from settled()
    driver.shot("dragged")
    color = bpy.data.materials["Material"].node_tree.nodes["Principled BSDF"].inputs["Base Color"]
    color.default_value = (0.8, 0.1, 0.1, 1)
    version = shown().request.state
    yield from settled()
    found["material"] = shown().request.state > version
    driver.shot("material")
    bpy.context.scene.render.film_transparent = True
    yield from settled()
    driver.shot("transparent")
    found["stall"] = window["stall"]
    for frame, x in ((1, -1), (20, 2)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    bpy.ops.screen.animation_play()
    yield 3.0
    bpy.ops.screen.animation_cancel(restore_frame=False)
    yield from settled()
    driver.shot("played")


def measure():
    """Seconds from a change to pictures, ours and those of Cycles in the same window."""
    rows, cycles, scene = [], bpy.context.scene.cycles, bpy.context.scene
    call(bpy.ops.view3d.view_camera)  # out of it: it would not orbit
    yield from settled()
    for change, make in CHANGES.items():
        begin = start_clock(make)
        yield from settled()
        pictures = [(at - begin, divisor) for at, divisor in window["shown"]]
        rows.append({"engine": "RenderFormer-V2", "change": change, "first": pictures[0][0],
                     "last": pictures[-1][0], "stall": window["stall"], "pictures": len(pictures)})
    yield from drag(rows)
    cycles.use_preview_denoising, cycles.preview_samples = True, SAMPLES
    found["cycles_denoises"] = cycles.preview_denoiser
    scene.render.engine = "CYCLES"
    yield quiet
    for change, make in CHANGES.items():
        begin = start_clock(make)
        yield quiet
        drawn = [at - begin for at in window["draws"] if at > begin][1:]  # the first one shows what was there before
        rows.append({"engine": "Cycles", "change": change, "first": drawn[0], "last": drawn[-1],
                     "stall": window["stall"], "pictures": len(drawn)})
    yield from dragged(rows, "Cycles")
    driver.shot("cycles")
    scene.render.engine = "RENDERFORMER_V2"
    yield from settled()
    write(rows)
    window["clock"] = False


def write(rows: list[dict]) -> None:
    with open(FOLDER / "viewport.csv", "w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows({key: f"{value:.2f}" if isinstance(value, float) else value for key, value in row.items()}
                        for row in rows)
    found["measured"] = rows


def drag(rows: list):
    yield from dragged(rows, "RenderFormer-V2")
    viewport().shading.type = "SOLID"
    yield 1.0
    yield from dragged(rows, "Solid")
    viewport().shading.type = "RENDERED"
    yield from settled()


def dragged(rows: list, engine: str):
    """How often the window is drawn in a second while an object moves and there is always something to do."""
    begin = start_clock(move_object)
    while time.perf_counter() - begin < DRAG:
        bpy.data.objects["Cube"].location.y -= 0.02
        yield 0.0
    seconds = time.perf_counter() - begin
    rows.append({"engine": engine, "change": "drag", "stall": window["stall"], "pictures": len(window["shown"]),
                 "redraws": sum(at > begin for at in window["draws"]) / seconds})


def move_view() -> None:
    call(bpy.ops.view3d.view_orbit, angle=0.2, type="ORBITLEFT")


def move_object() -> None:
    bpy.data.objects["Cube"].location.y += 0.2


CHANGES = {"camera": move_view, "move": move_object}


def start_clock(make) -> float:
    begin = window["begin"] = window["last"] = time.perf_counter()
    window["clock"] = True
    window["stall"], window["shown"], window["before"] = 0.0, [], works()[0].displayed if works() else None
    make()
    area("VIEW_3D").tag_redraw()
    return begin


def quiet() -> bool:
    return time.perf_counter() - max(window["draws"][-1], window["begin"]) > QUIET


def several():
    call(bpy.ops.screen.region_quadview)
    yield from settled()
    found["quad"] = len(works())
    driver.shot("quad")
    call(bpy.ops.screen.region_quadview)
    yield from settled()
    found["single"] = len(works())
    bpy.ops.object.select_all(action="DESELECT")
    bpy.data.objects["Cube"].select_set(True)
    call(bpy.ops.view3d.localview)
    yield from settled()
    found["local"] = len(shown().request.copied.things)
    driver.shot("local")
    call(bpy.ops.view3d.localview)
    yield from settled()
    found["global"] = len(shown().request.copied.things)


def misuse():
    """What a user does in between, while the viewport works."""
    said = found["said"] = {}

    def see(name: str):
        yield from settled()
        said[name] = works()[0].error
        driver.shot(name)
    for _ in range(3):
        bpy.data.objects["Cube"].location.z += 0.2
        call(bpy.ops.ed.undo_push, message="Move")
        yield 0.1
    for operator in (bpy.ops.ed.undo, bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.undo):
        call(operator)
        yield 0.1
    yield from see("undone")
    bpy.data.objects["Cube"].name = "Renamed"
    bpy.data.objects["Plane"].hide_set(True)
    yield 0.1
    bpy.data.objects["Plane"].hide_set(False)
    bpy.data.objects["Renamed"].name = "Cube"
    yield from see("hidden")
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=400, y_subdivisions=400, size=4, location=(0, 3, 0))
    window["stall"] = 0.0
    yield from see("large")
    found["large_stall"] = window["stall"]
    bpy.data.objects["Cube"].location.z += 0.1
    yield 0.05
    bpy.data.objects.remove(bpy.context.view_layer.objects.active)
    yield from see("deleted")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area("VIEW_3D")):
        bpy.ops.wm.window_new()
    other = bpy.context.window_manager.windows[-1]
    second = max(other.screen.areas, key=lambda each: each.width)
    second.type = "VIEW_3D"
    second.spaces.active.shading.type = "RENDERED"
    bpy.data.objects["Cube"].location.z += 0.1
    yield lambda: len(works()) == 2
    second.tag_redraw()
    yield 1.0
    yield from see("two_windows")
    found["two_windows"] = len(works())
    with bpy.context.temp_override(window=other):
        bpy.ops.wm.window_close()
    yield lambda: len(works()) == 1
    settings = bpy.context.scene.renderformer_v2
    settings.weights_source, settings.weights_folder = "FOLDER", "/nowhere"
    yield redrawn()
    yield 2.0
    driver.shot("no_weights")
    settings.weights_source = "BUNDLED"
    yield from see("weights_again")
    camera = bpy.context.scene.camera
    bpy.context.scene.camera = None
    yield from see("no_camera")
    bpy.context.scene.camera = camera
    kept = bpy.context.scene
    bpy.context.window_manager.windows[0].scene = empty = bpy.data.scenes.new("Empty")
    empty.render.engine = "RENDERFORMER_V2"
    empty.renderformer_v2.viewport.resolution = "8"
    yield redrawn()
    yield from see("empty")
    bpy.context.window_manager.windows[0].scene = kept
    yield redrawn()
    yield from see("back")


def render():
    """While the viewport works, and the scene changes meanwhile."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.progress import last_render
    bpy.data.objects["Cube"].location.z = 0.5
    yield 0.1
    bpy.ops.render.render("INVOKE_DEFAULT")
    yield is_rendering
    yield 0.5
    driver.shot("rendering")
    bpy.data.objects["Cube"].location.z = 0.0
    yield lambda: not is_rendering()
    found["rendered"] = [last_render.last_frame[0].error, last_render.last_frame[0].cancelled]
    yield from settled()
    found["after_render"] = works()[0].error
    driver.shot("after_render")


def leave():
    """In the middle of work: to another engine, to another file, out of the add-on, and out of Blender."""
    def disturb():
        bpy.data.objects["Cube"].location.z += 0.1
        yield 0.1
    yield from disturb()
    bpy.context.scene.render.engine = "CYCLES"
    yield 1.0
    found["other_engine"] = len(works())
    bpy.context.scene.render.engine = "RENDERFORMER_V2"
    yield from settled()
    yield from disturb()
    bpy.ops.wm.read_homefile(app_template="", use_factory_startup=True, load_ui=False)
    yield 0.5
    if EXTENSION not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module=EXTENSION)
    prepare()
    viewport().shading.type = "RENDERED"
    yield from settled()
    found["other_file"] = [works()[0].error, shown().triangles > 0]
    yield from disturb()
    bpy.ops.preferences.addon_disable(module=EXTENSION)
    yield 1.0
    driver.shot("disabled")
    bpy.ops.preferences.addon_enable(module=EXTENSION)
    yield from settled()
    found["enabled_again"] = works()[0].error
    yield from disturb()


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.view.render_display_type = "NONE"
driver.run(session())
