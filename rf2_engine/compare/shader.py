# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures on the graphics card, and the shader that shows one of them or the difference of two."""
from __future__ import annotations

import numpy as np

from mathutils import Matrix

LARGEST_BOX = 8  # texels across that are averaged where a picture is shown smaller than it is

VERTEX = """
void main()
{
  uv = mix(part.xy, part.zw, corner);
  gl_Position = projection * vec4(uv, 0.0, 1.0);
}
"""

FRAGMENT = """
vec4 box_average(sampler2D image, vec2 texels, int box)
{
  vec4 sum = vec4(0.0);
  ivec2 last = textureSize(image, 0) - 1;
  ivec2 first = box == 1 ? ivec2(floor(texels)) : ivec2(floor(texels - 0.5 * float(box) + 0.5));
  for (int y = 0; y < box; y++) {
    for (int x = 0; x < box; x++) {
      sum += texelFetch(image, clamp(first + ivec2(x, y), ivec2(0), last), 0);
    }
  }
  return sum / float(box * box);
}

void main()
{
  vec2 texels = (uv - area.xy) / (area.zw - area.xy) * vec2(textureSize(picture, 0));
  vec2 across = fwidth(texels);
  int box = clamp(int(round(max(across.x, across.y))), 1, LARGEST_BOX);
  color = box_average(picture, texels, box);
  if (gain >= 0.0) {
    color = vec4(abs(color.rgb - box_average(other, texels, box).rgb) * gain, 1.0);
  }
  color.a = max(color.a, opaque);
}
"""


def create():
    """A gpu.types.GPUShader for `draw`, which draws the unit square."""
    import gpu  # not in Blender without a window

    info, interface = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo("renderformer_v2_compare")
    interface.smooth("VEC2", "uv")
    info.vertex_in(0, "VEC2", "corner")
    info.vertex_out(interface)
    info.fragment_out(0, "VEC4", "color")
    info.push_constant("MAT4", "projection")  # together 128 bytes, which every driver takes
    info.push_constant("VEC4", "part")
    info.push_constant("VEC4", "area")
    info.push_constant("FLOAT", "gain")
    info.push_constant("FLOAT", "opaque")
    info.sampler(0, "FLOAT_2D", "picture")
    info.sampler(1, "FLOAT_2D", "other")
    info.define("LARGEST_BOX", str(LARGEST_BOX))
    info.vertex_source(VERTEX)
    info.fragment_source(FRAGMENT)
    return gpu.shader.create_from_info(info)


def texture(pixels: np.ndarray):
    """A gpu.types.GPUTexture of (H, W, 4), row 0 on top; of every n-th pixel where it is too large for the GPU."""
    import gpu

    step = -(-max(pixels.shape[:2]) // gpu.capabilities.max_texture_size_get())
    pixels = pixels[step // 2::step, step // 2::step]
    height, width, _ = pixels.shape
    values = np.ascontiguousarray(pixels[::-1], np.float32).ravel()
    return gpu.types.GPUTexture((width, height), format="RGBA16F" if np.abs(values).max() < 6e4 else "RGBA32F",
                                data=gpu.types.Buffer("FLOAT", values.size, values))


def draw(shader, picture, other=None, *, part=(0, 0, 1, 1), area=(0, 0, 1, 1), shift=0.0, gain=-1.0,
         opaque=False) -> None:
    """Draw `part` of the image's unit square, moved right by `shift`, with a texture that fills `area` of it.

    Parts and areas are left, bottom, right, top. A `gain` of 0 or more draws the difference from `other`; `opaque`
    ignores alpha.
    """
    import gpu
    from gpu_extras.batch import batch_for_shader

    batch = batch_for_shader(shader, "TRI_STRIP", {"corner": [(0, 0), (1, 0), (0, 1), (1, 1)]})
    shader.bind()
    _, _, width, height = gpu.state.viewport_get()
    half_pixel = Matrix.Translation((1 / width, 1 / height, 0))  # Blender samples its image at corners of pixels
    shader.uniform_float("projection", half_pixel @ gpu.matrix.get_projection_matrix()
                         @ gpu.matrix.get_model_view_matrix() @ Matrix.Translation((shift, 0, 0)))
    shader.uniform_float("part", part)
    shader.uniform_float("area", area)
    shader.uniform_float("gain", gain)
    shader.uniform_float("opaque", float(opaque))
    shader.uniform_sampler("picture", picture)
    shader.uniform_sampler("other", other or picture)
    batch.draw(shader)


def erase(left: float, right: float) -> None:
    """Remove what was drawn from `left` to `right`, in widths of the image: it would shine through a picture."""
    import gpu
    from gpu_extras.batch import batch_for_shader

    plain = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(left, 0), (right, 0), (left, 1), (right, 1)]
    plain.uniform_float("color", (0, 0, 0, 0))
    batch_for_shader(plain, "TRI_STRIP", {"pos": corners}).draw(plain)
