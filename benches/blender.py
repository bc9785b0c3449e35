"""Error against CPU seconds of Blender's Cycles on a half-space under fringes: the planar rows of "Beside Cycles" in docs/validation.md.

    pip install bpy==5.0.1 numpy        (Python 3.11)
    python benches/blender.py A_RHO S_RHO PATHS

The scene of benches/error_time.rs: 64 x 64 pixels of 1 mm, camera 500 mm above, projector (a point that lights a square of 256 mm) 35 mm beside it,
f_x = 0.1 mm^-1, three phases, g = 0.8, n = 1. Twice with other random numbers: half the mean square of the difference is the variance of a pixel. M_AC is the
component along the phase of the carrier, which noise does not make larger. Prints CPU seconds of a set of three images, the errors of M_DC and M_AC, the
seconds to 1 % of both, and M_AC / M_DC, which turbid's frames must have too.
"""
import math
import os
import resource
import sys
import tempfile

import bpy
import numpy as np

F_X, DISTANCE, ASIDE, FIELD, PIXELS, PHASES = 0.1, 500.0, 35.0, 256.0, 64, 3


def settings(paths):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples = "CPU", paths
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    # As many scatterings as it allows; nothing is clamped or left out.
    cycles.max_bounces = cycles.volume_bounces = 1024
    cycles.light_sampling_threshold = cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"
    scene.world = bpy.data.worlds.new("dark")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes.clear()
    return scene


def half_space(mu_a, mu_s):
    bpy.ops.mesh.primitive_cube_add(size=2000, location=(0, 0, -1000))
    medium = bpy.data.materials.new("medium")
    medium.use_nodes = True
    tree = medium.node_tree
    tree.nodes.clear()
    scatter, absorb = tree.nodes.new("ShaderNodeVolumeScatter"), tree.nodes.new("ShaderNodeVolumeAbsorption")
    scatter.inputs["Color"].default_value, absorb.inputs["Color"].default_value = (1, 1, 1, 1), (0, 0, 0, 1)
    scatter.inputs["Density"].default_value, absorb.inputs["Density"].default_value = mu_s, mu_a
    scatter.inputs["Anisotropy"].default_value = 0.8
    both, output = tree.nodes.new("ShaderNodeAddShader"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(scatter.outputs[0], both.inputs[0])
    tree.links.new(absorb.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], output.inputs["Volume"])
    bpy.context.object.data.materials.append(medium)


def camera(scene):
    lens = bpy.data.cameras.new("camera")
    lens.sensor_width, lens.lens, lens.clip_end = 32, 32 * DISTANCE / PIXELS, 5000
    scene.camera = bpy.data.objects.new("camera", lens)
    scene.camera.location = (0, 0, DISTANCE)
    scene.collection.objects.link(scene.camera)


def projector(scene):
    """The node whose value is the phase."""
    lamp = bpy.data.lights.new("projector", "POINT")
    lamp.energy, lamp.shadow_soft_size, lamp.use_nodes = 1e6, 0.0, True
    place = bpy.data.objects.new("projector", lamp)
    place.location = (ASIDE, 0, DISTANCE)
    scene.collection.objects.link(place)
    tree = lamp.node_tree
    tree.nodes.clear()

    def maths(operation, *inputs):
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, of in zip(node.inputs, inputs):
            if isinstance(of, float):
                socket.default_value = of
            else:
                tree.links.new(of, socket)
        return node.outputs[0]

    # The lamp is not turned, so its "normal" is the direction of the ray; (x, y) where that meets the surface.
    where, axes = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(where.outputs["Normal"], axes.inputs[0])
    down = maths("ABSOLUTE", axes.outputs[2])
    x = maths("ADD", maths("MULTIPLY", maths("DIVIDE", axes.outputs[0], down), DISTANCE), ASIDE)
    y = maths("MULTIPLY", maths("DIVIDE", axes.outputs[1], down), DISTANCE)
    phase = tree.nodes.new("ShaderNodeValue")
    turns = maths("ADD", maths("MULTIPLY", x, 2 * math.pi * F_X), phase.outputs[0])
    fringes = maths("ADD", maths("MULTIPLY", maths("COSINE", turns), 0.5), 0.5)
    inside = [maths("LESS_THAN", maths("ABSOLUTE", axis), FIELD / 2) for axis in (x, y)]
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputLight")
    tree.links.new(maths("MULTIPLY", fringes, maths("MULTIPLY", *inside)), emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs[0])
    return phase.outputs[0]


def cpu_seconds():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def image(scene, phase, value, seed, path):
    phase.default_value, scene.cycles.seed, scene.render.filepath = value, seed, path
    began = cpu_seconds()
    bpy.ops.render.render(write_still=True)
    seconds = cpu_seconds() - began
    loaded = bpy.data.images.load(path)
    loaded.colorspace_settings.name = "Non-Color"
    pixels = np.array(loaded.pixels[:]).reshape(PIXELS, PIXELS, 4)[:, :, 0].astype(float)
    bpy.data.images.remove(loaded)
    return pixels, seconds


def main():
    a_rho, s_rho, paths = float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = settings(paths)
    half_space(a_rho / 1000, s_rho / 1000)
    camera(scene)
    phase = projector(scene)
    steps = [2 * math.pi * k / PHASES for k in range(PHASES)]
    sets, seconds = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        for repeat in range(2):
            shots = [image(scene, phase, s, 1 + 10 * repeat + k, os.path.join(folder, "o.exr")) for k, s in enumerate(steps)]
            seconds += sum(s for _, s in shots) / 2
            dc = sum(pixels for pixels, _ in shots) / PHASES
            ac = sum(pixels * np.exp(-1j * s) for (pixels, _), s in zip(shots, steps)) * 2 / PHASES
            sets.append((dc, ac))
    across = np.exp(-2j * math.pi * F_X * (np.arange(PIXELS) - (PIXELS - 1) / 2))
    common = np.angle(sum((ac * across).mean() for _, ac in sets))
    values = [[dc, (ac * across * np.exp(-1j * common)).real] for dc, ac in sets]
    means = [(a + b).mean() / 2 for a, b in zip(*values)]
    errors = [math.sqrt(((a - b) ** 2).mean() / 2) / mean for a, b, mean in zip(*values, means)]
    to_one = [seconds * (100 * error) ** 2 for error in errors]
    print(f"({a_rho:g}, {s_rho:g}), {paths} paths: {seconds:.1f} CPU s, errors {100 * errors[0]:.1f}, {100 * errors[1]:.1f} %,", end=" ")
    print(f"to 1 %: {to_one[0]:.0f}, {to_one[1]:.0f} CPU s; M_AC / M_DC {means[1] / means[0]:.4f}")


main()
