# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the state of the Python packages: missing, confirmation before installing, being installed."""
from __future__ import annotations

from ..setup import extension, importing, package_install, packages, wheels
from ..setup.display import draw_progress, draw_text, format_size, free_space

SLOWER = {  # what takes longer without a package that a render can do without
    "fast_simplification": "meshes are simplified in several times the time",
    "embreex": "rays take ten times as long",
}


def draw_packages(layout, group: dict[str, str], published: bool = False) -> None:
    """Missing packages of packages.PACKAGES or PUBLISHED, with a button to install them; nothing if all are there."""
    installation = package_install.current.process
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
        _draw_missing(layout, missing, published)
    elif problem := packages.too_old() or importing.failure():
        draw_text(layout, problem)
    elif installation and installation.state == "done" and installation.was_loaded:
        draw_text(layout, "Start Blender again to use the new packages", icon="INFO")


def _draw_missing(layout, missing: list[str], published: bool) -> None:
    several = "s" if len(missing) > 1 else ""
    draw_text(layout, f"Missing Python package{several}: {', '.join(missing)}", icon="INFO" if published else "ERROR")
    consequences = [SLOWER[name] for name in missing if name in SLOWER]
    if consequences and not set(missing) & set(packages.NETWORK):
        draw_text(layout, f"Scenes render without {'them' if several else 'it'}, but slower: "
                          f"{', '.join(consequences)}", icon="INFO")
    if problem := packages.unavailable(missing):
        draw_text(layout, problem)
        return
    layout.operator("renderformer_v2.install_packages", icon="IMPORT").published = published
    if reason := packages.refusal():
        draw_text(layout, reason, icon="INFO")


def draw_build(layout) -> None:
    """The build of PyTorch; Linux and Windows have two to choose from."""
    preferences = extension.preferences()
    if installed := packages.installed_build():
        layout.label(text=f"Installed: PyTorch for {installed}", icon="INFO")
    if not wheels.has_builds():
        return
    layout.prop(preferences, "torch_build")
    if preferences.torch_build == "AUTO":
        article = "An" if wheels.has_nvidia_driver() else "No"
        layout.label(text=f"{article} NVIDIA driver was found: the {packages.build()} build", icon="INFO")
    if wheels.torch_distribution(packages.build()) == wheels.CPU_TORCH:
        layout.prop(preferences, "torch_cpu_index")
    elif wheels.torch_distribution(packages.build()) == wheels.CUDA_TORCH:
        layout.prop(preferences, "torch_cuda_index")


def draw_choices(layout) -> None:
    """Build of PyTorch, index, repair."""
    draw_build(layout)
    layout.prop(extension.preferences(), "package_index")
    if packages.installed() and not package_install.current.is_running:
        if other := packages.other_build():
            layout.operator("renderformer_v2.install_packages", icon="IMPORT", text=f"Change to the {other} Build")
        layout.operator("renderformer_v2.repair_packages", icon="FILE_REFRESH")


def draw_confirmation(layout, needed: list[wheels.Wheel], by_content: bool) -> None:
    """What an installation will do, before it begins."""
    target = packages.folder()
    if by_content:
        layout.label(text="All files are checked. Damaged packages are downloaded again, at most:")
    names = sorted(needed, key=lambda wheel: -wheel.download)
    draw_text(layout, ", ".join(f"{wheel.name} {wheel.version}" for wheel in names[:6])
              + (f" and {len(names) - 6} more" if len(names) > 6 else ""), icon="PACKAGE")
    layout.label(text=f"{format_size(sum(wheel.download for wheel in needed))} to download, about "
                      f"{format_size(sum(wheel.unpacked for wheel in needed))} on disk")
    layout.label(text=f"About {format_size(wheels.space_needed(needed))} needed during installation, "
                      f"{format_size(free_space(target))} free")
    draw_text(layout, f"Installed into {target}", icon="FILE_FOLDER")
