// Copies what was blended into the film, over what is behind the gas. See src/render/gpu/raster.rs.

const TILE: u32 = 16u;
const SURFACES: u32 = 4u;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> window: Window;
// Per pixel: colour of what is behind the gas and its depth in the method's measure.
@group(0) @binding(2) var<storage, read> surfaces: array<vec4<f32>>;
// Per pixel: colour and transmittance.
@group(0) @binding(3) var<storage, read_write> film: array<vec4<f32>>;
// Tiles copied, and marks in the row below the picture.
@group(0) @binding(4) var<storage, read_write> tally: array<atomic<u32>, 2>;
@group(0) @binding(5) var blended: texture_2d<f32>;

@compute @workgroup_size(16, 16)
fn resolve(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let at = tile.xy * TILE + local.xy;
    if at.x < window.columns && at.y < view.size.y {
        let place = at.y * view.size.x + window.first + at.x;
        let gas = textureLoad(blended, vec2<u32>(window.at + at.x, at.y), 0);
        var behind = vec4<f32>(view.background, 3.4028234e38);
        if (view.flags & SURFACES) != 0u {
            behind = surfaces[place];
        }
        let color = fma(vec3<f32>(gas.a), behind.rgb, gas.rgb);
        // Light of the background alone counts: nothing comes through a surface.
        film[place] = vec4<f32>(color, select(gas.a, 0.0, behind.w < 3e38));
        if at.y == 0u {
            let marks = textureLoad(blended, vec2<u32>(window.at + at.x, view.size.y), 0).r;
            atomicAdd(&tally[1], u32(marks + 0.5));
        }
    }
    if index == 0u {
        atomicAdd(&tally[0], 1u);
    }
}
