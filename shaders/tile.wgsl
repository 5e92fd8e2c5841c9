// One workgroup composites the particles of one tile, nearest first, with colour and transmittance in registers. The particles
// come in batches through workgroup memory; when no pixel lets more than `stop` through, the rest is left out.

const BATCH: u32 = 64u;

@group(0) @binding(1) var<storage, read> splats: array<Splat>;

var<workgroup> batch: array<Splat, BATCH>;

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

    let behind = behind_gas(inside, place);
    let pixel = Pixel(picture, 1.0 / (dot(tangent, tangent) + 1.0), behind.w);

    let before = so_far(inside, place);
    var color = before.rgb;
    var transmittance = before.a;

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
        if !is_open(transmittance, index) {
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
        write_pixel(place, color, transmittance, behind);
    }
    count_tile(index, composited, opaque_enough || composited == length);
}
