# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user does in a Rendered viewport: `blender --python viewport_session.py -- ZIP FOLDER`."""
import sys
import time
from pathlib import Path

import bpy

sys.path.append(str(Path(__file__).parent))
from driver import Driver, area, is_rendering, region  # noqa: E402  it lies beside this file

ARCHIVE, FOLDER = map(Path, sys.argv[sys.argv.index("--") + 1:])
EXTENSION = "bl_ext.user_default.renderformer_v2"
TICK = 0.01     # seconds between two looks at whether the window stands still
PICTURES = 3    # that are to be seen during a drag

driver = Driver(FOLDER)
found = driver.found
window = {"last": 0.0, "stall": 0.0, "draws": 0}


def session():
    bpy.ops.extensions.package_install_files(filepath=str(ARCHIVE), repo="user_default", enable_on_install=True)
    bpy.context.preferences.view.smooth_view = 0
    bpy.app.timers.register(tick, persistent=True)
    bpy.types.SpaceView3D.draw_handler_add(count_draw, (), "WINDOW", "POST_PIXEL")
    prepare()
    yield 1.0
    yield from enter()
    yield from look_around()
    yield from edit()
    yield from several()
    yield from render()
    yield from leave()


def tick() -> float:
    now = time.perf_counter()
    window["stall"], window["last"] = max(window["stall"], now - window["last"] - TICK), now
    return TICK


def works() -> list:
    """The sessions of the viewports that there are."""
    from bl_ext.user_default.renderformer_v2.rf2_engine.viewport.worker import worker
    return [work for work in worker.works() if not work.closed]


def done() -> bool:
    return bool(works()) and all(work.request and not work.wants() and not work.doing for work in works())


def count_draw() -> None:
    window["draws"] += 1


def redrawn():
    before = window["draws"]
    area("VIEW_3D").tag_redraw()
    return lambda: window["draws"] > before


def settled():
    """Until the finest pictures are on the screen."""
    yield redrawn()  # so that it was asked for them
    while not done():
        yield done
        yield redrawn()
    yield 0.2


def shown():
    return works()[0].shown


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
    found["local"] = shown().triangles
    driver.shot("local")
    call(bpy.ops.view3d.localview)
    yield from settled()
    found["global"] = shown().triangles


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
