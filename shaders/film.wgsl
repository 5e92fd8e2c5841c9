// How the tile shaders begin and end with a pixel, and whether a tile goes on.

const TILE: u32 = 16u;
const FIRST: u32 = 1u;
const LAST: u32 = 2u;
const SURFACES: u32 = 4u;

var<workgroup> votes: atomic<u32>;
var<workgroup> open: u32;

// Colour and depth of what is behind a pixel.
fn behind_gas(inside: bool, number: u32) -> vec4<f32> {
    if inside && (view.flags & SURFACES) != 0u {
        return surfaces[number];
    }
    return vec4<f32>(view.background, 3.4028234e38);
}

// Colour and transmittance of a pixel before this batch; beyond the picture nothing comes through.
fn so_far(inside: bool, number: u32) -> vec4<f32> {
    if !inside {
        return vec4<f32>(0.0);
    }
    if (view.flags & FIRST) != 0u {
        return vec4<f32>(0.0, 0.0, 0.0, 1.0);
    }
    return film[number];
}

// Whether any pixel of the tile lets more than `stop` through.
fn is_open(through: f32, index: u32) -> bool {
    if through > view.stop {
        atomicStore(&votes, 1u);
    }
    workgroupBarrier();
    if index == 0u {
        open = atomicExchange(&votes, 0u);
    }
    return workgroupUniformLoad(&open) != 0u;
}

// Writes a pixel; after the last batch with what is behind the gas.
fn write_pixel(number: u32, gas: vec3<f32>, transmittance: f32, behind: vec4<f32>) {
    var light = gas;
    var through = transmittance;
    if (view.flags & LAST) != 0u {
        light = fma(vec3<f32>(through), behind.rgb, light);
        // Light of the background alone counts: nothing comes through a surface.
        through = select(through, 0.0, behind.w < 3e38);
    }
    film[number] = vec4<f32>(light, through);
}

// Counts the particles that a tile composited, and the tile if it went through its lists: a driver that ends long loops early, as
// llvmpipe does, must not go unnoticed.
fn count_tile(index: u32, composited: u32, complete: bool) {
    if index == 0u {
        atomicAdd(&tally[1], composited);
        if complete {
            atomicAdd(&tally[0], 1u);
        }
    }
}
