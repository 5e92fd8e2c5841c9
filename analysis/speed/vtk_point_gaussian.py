"""Times VTK's point-Gaussian mapper on the same particles: what one would use instead.

    pip install vtk numpy
    python3 vtk_point_gaussian.py PARTICLES.csv --radius 0.4 [--opacity 0.4] [--grey 0.7] [--frames 5] [--warmup 2]

One stereo frame is the work that `stereomist bench` measures: two eyes 0.06 apart, each a picture of 1024x768 with a
vertical field of view of 60 degrees and its centre line through the point 2 units ahead, read back to memory, the camera
1e-4 further forward each time. A particle is a disc parallel to the view plane with opacity rho exp(-4.5 d^2), d the
distance from its centre over its radius, over a background of (0.1, 0.2, 0.3).

PARTICLES.csv has the columns x,y,z in camera space: eye at the origin, looking along -z, y up.

Differences that are left: VTK does not sort, which with one colour does not show in the picture; it blends into 8 bits
per channel; and its splat ends at the rim of the disc where stereomist's goes on to the corners of the square.
`--compare LEFT.png` (16 bits, from `stereomist render`) prints how far the left pictures are apart.

Prints one JSON object: median_ms, min_ms, frames_ms.
"""

import argparse
import json
import math
import statistics
import time

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

WIDTH, HEIGHT = 1024, 768
FOV_Y_DEG = 60.0
INTEROCULAR = 0.06
CONVERGENCE = 2.0
BACKGROUND = (0.1, 0.2, 0.3)
STEP = 1e-4


def splats(positions, radius, opacity, grey):
    """An actor that draws every particle as a Gaussian disc."""
    cloud = vtk.vtkPolyData()
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(positions, deep=True))
    cloud.SetPoints(points)

    mapper = vtk.vtkPointGaussianMapper()
    mapper.SetInputData(cloud)
    mapper.ScalarVisibilityOff()
    mapper.EmissiveOff()
    # The mapper's unit of offset is sigma = radius / 3; the splat reaches 3 sigma.
    mapper.SetScaleFactor(radius / 3.0)
    mapper.SetBoundScale(3.0)
    mapper.SetSplatShaderCode(
        "//VTK::Color::Impl\n"
        "float square = dot(offsetVCVSOutput.xy, offsetVCVSOutput.xy);\n"
        "if (square > 9.0) { discard; }\n"
        f"opacity = {opacity:.9f} * exp(-0.5 * square);\n"
        f"ambientColor = vec3(0.0);\n"
        f"diffuseColor = vec3({grey:.9f});\n"
    )
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.ForceTranslucentOn()
    return actor


class Stereo:
    """An off-screen window that draws one eye after the other."""

    def __init__(self, actor):
        renderer = vtk.vtkRenderer()
        renderer.SetBackground(*BACKGROUND)
        renderer.AddActor(actor)
        self.window = vtk.vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.window.SetSize(WIDTH, HEIGHT)
        self.window.AddRenderer(renderer)
        self.camera = renderer.GetActiveCamera()
        self.camera.SetViewAngle(FOV_Y_DEG)
        self.camera.SetViewUp(0.0, 1.0, 0.0)
        self.camera.SetClippingRange(0.05, 10.0)
        self.grab = vtk.vtkWindowToImageFilter()
        self.grab.SetInput(self.window)
        self.grab.SetInputBufferTypeToRGB()
        self.grab.ReadFrontBufferOff()

    def draw(self, frame):
        """Draws both eyes; returns the left picture, rows from the top."""
        left = None
        half_width = math.tan(math.radians(FOV_Y_DEG / 2)) * WIDTH / HEIGHT
        for eye in (-INTEROCULAR / 2, INTEROCULAR / 2):
            z = -STEP * frame
            self.camera.SetPosition(eye, 0.0, z)
            self.camera.SetFocalPoint(eye, 0.0, z - 1.0)
            # An off-axis frustum through the point in the zero-parallax plane.
            self.camera.SetWindowCenter(-eye / CONVERGENCE / half_width, 0.0)
            self.window.Render()
            self.grab.Modified()
            self.grab.Update()
            if left is None:
                left = self.grab.GetOutput()
                left = vtk_to_numpy(left.GetPointData().GetScalars()).reshape(HEIGHT, WIDTH, 3)[::-1].copy()
        return left


def difference(left, path):
    """Mean and greatest difference of the left eye from stereomist's, in linear light, in steps of 1/255."""
    reader = vtk.vtkPNGReader()
    reader.SetFileName(path)
    reader.Update()
    ours = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    ours = ours.reshape(HEIGHT, WIDTH, -1)[::-1, :, :3] / np.iinfo(ours.dtype).max
    ours = np.where(ours <= 0.04045, ours / 12.92, ((ours + 0.055) / 1.055) ** 2.4)
    apart = np.abs(left / 255.0 - ours) * 255.0
    return {"mean_255": round(float(apart.mean()), 3), "max_255": round(float(apart.max()), 3)}


def main():
    parser = argparse.ArgumentParser(description="Times VTK's point-Gaussian mapper on a CSV of particles.")
    parser.add_argument("particles")
    parser.add_argument("--radius", type=float, required=True)
    parser.add_argument("--opacity", type=float, default=0.4)
    parser.add_argument("--grey", type=float, default=0.7)
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--warmup", type=int, default=2)
    parser.add_argument("--compare", metavar="LEFT.png")
    options = parser.parse_args()

    positions = np.loadtxt(options.particles, np.float32, delimiter=",", skiprows=1, usecols=(0, 1, 2), ndmin=2)
    stereo = Stereo(splats(positions, options.radius, options.opacity, options.grey))
    first = stereo.draw(0)
    times = []
    # The first picture has warmed up once already.
    for frame in range(1, max(options.warmup, 1) + options.frames):
        start = time.perf_counter()
        stereo.draw(frame)
        times.append((time.perf_counter() - start) * 1e3)
    times = times[-options.frames:]

    # "llvmpipe" here means that VTK drew on the CPU.
    drawn_by = [line.split(":", 1)[1].strip() for line in stereo.window.ReportCapabilities().splitlines()
                if line.startswith("OpenGL renderer string:")]
    result = {
        "peer": f"VTK {vtk.vtkVersion.GetVTKVersion()} vtkPointGaussianMapper",
        "window": stereo.window.GetClassName(),
        "drawn_by": drawn_by[0] if drawn_by else "",
        "particles": len(positions),
        "median_ms": statistics.median(times),
        "min_ms": min(times),
        "frames_ms": times,
    }
    if options.compare:
        result["difference"] = difference(first, options.compare)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
