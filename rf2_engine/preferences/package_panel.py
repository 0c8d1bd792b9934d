# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the state of the Python packages: missing, the question before they are installed, being installed."""
from __future__ import annotations

from ..setup import importing, package_install, packages, wheels
from ..setup.display import amount, draw_progress, draw_text, free_space


def draw_packages(layout, group: dict[str, str], published: bool = False) -> None:
    """What is missing of packages.PACKAGES or PUBLISHED, with the button for it; nothing when all is there."""
    installation = package_install.current
    if installation and installation.is_running:
        percent = 100 * installation.present // max(installation.total, 1)  # unpacked sizes are estimates
        draw_progress(layout, installation, f"about {percent} %  {installation.text}")
        if installation.state == "cancelling":
            layout.label(text="Removing temporary files")
        else:
            layout.operator("renderformer_v2.cancel_packages", icon="CANCEL")
        return
    if installation and installation.state == "failed":
        draw_text(layout, installation.error)
    if missing := packages.missing(group):
        draw_text(layout, f"Missing Python packages: {', '.join(missing)}")
        if "fast_simplification" in missing and not set(missing) & set(packages.NETWORK):
            draw_text(layout, "Scenes whose meshes fit into Max Triangles render without it", icon="INFO")
        if problem := packages.unavailable(missing):
            draw_text(layout, problem)
            return
        layout.operator("renderformer_v2.install_packages", icon="IMPORT").published = published
        if reason := packages.refusal():
            draw_text(layout, reason, icon="INFO")
    elif problem := packages.too_old() or importing.failure():
        draw_text(layout, problem)
    elif installation and installation.state == "done" and installation.was_loaded:
        draw_text(layout, "Start Blender again to use the new packages", icon="INFO")


def draw_build(layout) -> None:
    """Linux and Windows have two builds of PyTorch to choose from."""
    preferences = packages.preferences()
    if installed := packages.installed_build():
        layout.label(text=f"Installed: PyTorch for {installed}", icon="INFO")
    if not wheels.has_builds():
        return
    layout.prop(preferences, "torch_build")
    if preferences.torch_build == "AUTO":
        found = "An" if wheels.has_nvidia_driver() else "No"
        layout.label(text=f"{found} NVIDIA driver was found: the {packages.build()} build", icon="INFO")
    if wheels.torch_of(packages.build()) == wheels.CPU_TORCH:
        layout.prop(preferences, "torch_cpu_index")
    elif wheels.torch_of(packages.build()) == wheels.CUDA_TORCH:
        layout.prop(preferences, "torch_cuda_index")


def draw_choices(layout) -> None:
    """Build of PyTorch, index, repair."""
    draw_build(layout)
    layout.prop(packages.preferences(), "package_index")
    if packages.installed() and not package_install.is_running():
        if other := packages.other_build():
            layout.operator("renderformer_v2.install_packages", icon="IMPORT", text=f"Change to the {other} Build")
        layout.operator("renderformer_v2.repair_packages", icon="FILE_REFRESH")


def draw_confirmation(layout, wanted: list[wheels.Wheel], by_content: bool) -> None:
    """The question before an installation."""
    target = packages.folder()
    if by_content:
        layout.label(text="All files are checked. Damaged packages are downloaded again, at most:")
    names = sorted(wanted, key=lambda wheel: -wheel.download)
    draw_text(layout, ", ".join(f"{wheel.name} {wheel.version}" for wheel in names[:6])
              + (f" and {len(names) - 6} more" if len(names) > 6 else ""), icon="PACKAGE")
    layout.label(text=f"{amount(sum(wheel.download for wheel in wanted))} to download, about "
                      f"{amount(sum(wheel.unpacked for wheel in wanted))} on disk")
    layout.label(text=f"About {amount(wheels.space_needed(wanted))} needed during installation, "
                      f"{amount(free_space(target))} free")
    draw_text(layout, f"Installed into {target}", icon="FILE_FOLDER")
