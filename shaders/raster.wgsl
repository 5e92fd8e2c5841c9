// Billboards drawn as such: an instance each, nearest first, blended beneath what is there. See src/render/gpu/raster.rs.

const SURFACES: u32 = 4u;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> window: Window;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> tables: array<f32>;
// Per pixel: colour of what is behind the gas and its depth in the method's measure.
@group(0) @binding(4) var<storage, read> surfaces: array<vec4<f32>>;

// A corner of a billboard, and the particle as its fragments read it: the same at all corners.
struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) forms: vec4<f32>,
    @location(1) @interpolate(flat) both: vec4<f32>,
    @location(2) @interpolate(flat) ahead: vec4<f32>,
    @location(3) @interpolate(flat) color: vec4<f32>,
    @location(4) @interpolate(flat) rest: vec4<f32>,
    @location(5) @interpolate(flat) inverse: f32,
    @location(6) @interpolate(flat) table: u32,
}

// `outline`: first column and row of the pixels it covers, and those after the last.
@vertex
fn billboard(
    @builtin(vertex_index) number: u32,
    @builtin(instance_index) instance: u32,
    @location(0) outline: vec4<u32>,
) -> Corner {
    // Edges are those of pixels, whatever rounding does to them: it moves them by much less than half a pixel.
    let columns = clamp(outline.xz, vec2<u32>(window.first), vec2<u32>(window.first + window.columns));
    let x = select(columns.x, columns.y, (number & 1u) != 0u) - window.first + window.at;
    let y = select(outline.y, outline.w, number > 1u);
    let place = 2.0 * vec2<f32>(vec2<u32>(x, y)) / vec2<f32>(window.extent);
    // The last instance is a mark and no particle.
    let splat = splats[min(instance, arrayLength(&splats) - 1u)];
    return Corner(
        vec4<f32>(place.x - 1.0, 1.0 - place.y, 0.0, 1.0),
        vec4<f32>(splat.x, splat.y),
        vec4<f32>(splat.both, splat.own),
        vec4<f32>(splat.ahead, splat.front),
        vec4<f32>(splat.color, splat.amplitude),
        vec4<f32>(splat.anchor, splat.most, splat.intervals),
        splat.inverse,
        splat.table,
    );
}

// Colour times opacity, and opacity.
@fragment
fn shade(corner: Corner) -> @location(0) vec4<f32> {
    let at = vec2<u32>(corner.position.xy);
    // The row below the picture counts the draws that came to their end.
    if at.y >= view.size.y {
        return vec4<f32>(1.0, 0.0, 0.0, 0.0);
    }
    let column = at.x - window.at + window.first;
    let picture = vec2<f32>(vec2<u32>(column, at.y + view.first_row));
    let tangent = fma(picture, view.step, view.tangent);
    var limit = 3.4028234e38;
    if (view.flags & SURFACES) != 0u {
        limit = surfaces[at.y * view.size.x + column].w;
    }
    let pixel = Pixel(picture, 1.0 / (dot(tangent, tangent) + 1.0), limit);
    let splat = Splat(
        corner.forms.xy,
        corner.forms.zw,
        corner.both.xyz,
        corner.both.w,
        corner.ahead.xyz,
        corner.ahead.w,
        corner.color.xyz,
        corner.color.w,
        corner.rest.xy,
        corner.rest.z,
        corner.rest.w,
        corner.table,
        corner.inverse,
    );
    let alpha = opacity(splat.amplitude * footprint(splat, pixel));
    return vec4<f32>(alpha * splat.color, alpha);
}
