// One workgroup composites the particles of one tile, nearest first, with colour and transmittance in registers. The particles
// come in batches through workgroup memory; when no pixel lets more than `stop` through, the rest is left out.

const TILE: u32 = 16u;
const BATCH: u32 = 64u;
const FIRST: u32 = 1u;
const LAST: u32 = 2u;
const SURFACES: u32 = 4u;

@group(0) @binding(1) var<storage, read> splats: array<Splat>;

var<workgroup> batch: array<Splat, BATCH>;
var<workgroup> votes: atomic<u32>;
var<workgroup> open: u32;

@compute @workgroup_size(16, 16)
fn composite_tile(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let at = tile.xy * TILE + local.xy;
    let inside = all(at < view.size);
    let place = at.y * view.size.x + at.x;
    let picture = vec2<f32>(vec2<u32>(at.x, at.y + view.first_row));
    let tangent = fma(picture, view.step, view.tangent);

    var behind = vec4<f32>(view.background, 3.4028234e38);
    if inside && (view.flags & SURFACES) != 0u {
        behind = surfaces[place];
    }
    let pixel = Pixel(picture, 1.0 / (dot(tangent, tangent) + 1.0), behind.w);

    var color = vec3<f32>(0.0);
    var transmittance = 1.0;
    if !inside {
        transmittance = 0.0;
    } else if (view.flags & FIRST) == 0u {
        color = film[place].rgb;
        transmittance = film[place].a;
    }

    let number = tile.y * view.across + tile.x;
    let end = starts[number + 1u];
    var next = starts[number];
    let length = end - next;
    var composited = 0u;
    var opaque_enough = false;
    loop {
        if next >= end {
            break;
        }
        if transmittance > view.stop {
            atomicStore(&votes, 1u);
        }
        workgroupBarrier();
        if index == 0u {
            open = atomicExchange(&votes, 0u);
        }
        if workgroupUniformLoad(&open) == 0u {
            opaque_enough = true;
            break;
        }
        let count = min(BATCH, end - next);
        if index < count {
            batch[index] = splats[list[next + index]];
        }
        workgroupBarrier();
        var i = 0u;
        for (; i < count; i++) {
            let alpha = opacity(batch[i].amplitude * footprint(batch[i], pixel));
            let share = transmittance * alpha;
            color = fma(vec3<f32>(share), batch[i].color, color);
            transmittance -= share;
        }
        composited += i;
        next += count;
        workgroupBarrier();
    }

    if inside {
        if (view.flags & LAST) != 0u {
            color = fma(vec3<f32>(transmittance), behind.rgb, color);
            // Light of the background alone counts: nothing comes through a surface.
            transmittance = select(transmittance, 0.0, behind.w < 3e38);
        }
        film[place] = vec4<f32>(color, transmittance);
    }
    if index == 0u {
        atomicAdd(&tally[1], composited);
        // A driver that ends long loops early (llvmpipe does) must not go unnoticed.
        if opaque_enough || composited == length {
            atomicAdd(&tally[0], 1u);
        }
    }
}
