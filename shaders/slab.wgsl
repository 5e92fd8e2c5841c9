// One workgroup goes through the slabs of one tile, front to back, eight at a time in registers: each holds the optical depth of
// its gas and that times the colour; see src/render/method/slab.rs. The lists are per tile and eight slabs.

const BATCH: u32 = 64u;
const SLABS: u32 = 8u;

// Optical depth that counts as none.
const LEAST: f32 = 1e-12;

const GAUSSIAN: u32 = 0u;
const BELIAEV: u32 = 1u;
const CONSTANT: u32 = 2u;
const POLY: u32 = 3u;

@group(0) @binding(1) var<storage, read> balls: array<Ball>;

var<workgroup> batch: array<Ball, BATCH>;

// Optical depth from the point of the ray nearest the centre to the distance u, over the amplitude.
fn primitive(ball: u32, square: f32, u: f32) -> f32 {
    switch batch[ball].shape {
        case GAUSSIAN: { return gaussian_primitive(square, u); }
        case BELIAEV: { return beliaev_primitive(square, u); }
        case CONSTANT: { return constant_primitive(u); }
        case POLY: { return poly_primitive(square, u); }
        default: { return shells_primitive(square, u, batch[ball].shell, batch[ball].shells); }
    }
}

// A ray in a ball: square of its distance from the centre, |dir|, where it is nearest the centre, where it ends, the ball's place in
// the batch, its amplitude alone and times the colour, the distance of the planes, and the first plane of the group.
struct Ray {
    square: f32,
    length: f32,
    closest: f32,
    stop: f32,
    ball: u32,
    content: vec4<f32>,
    step: f32,
    plane: f32,
}

// What lies between `front` (distance from the middle of the chord, and the primitive there) and plane `number` of the group,
// which becomes the new front.
fn segment(ray: Ray, number: u32, first: u32, front: ptr<function, vec2<f32>>) -> vec4<f32> {
    let z = fma(f32(number), ray.step, ray.plane);
    let met = clamp(z * ray.length - ray.closest, (*front).x, ray.stop);
    let to = select(met, ray.stop, first + number == view.slabs);
    if !(to > (*front).x) {
        return vec4<f32>(0.0);
    }
    let after = primitive(ray.ball, ray.square, to);
    let share = after - (*front).y;
    *front = vec2<f32>(to, after);
    return ray.content * share;
}

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
    let length_squared = dot(tangent, tangent) + 1.0;
    let length = sqrt(length_squared);

    let behind = behind_gas(inside, place);
    let before = so_far(inside, place);
    var light = before.rgb;
    var through = before.a;
    var off = off_so_far(inside, place);

    let down = (view.size.y + TILE - 1u) / TILE;
    let lists = view.across * down + 1u;
    let number = tile.y * view.across + tile.x;
    var composited = 0u;
    var length_of_lists = 0u;
    var opaque_enough = false;
    var group = 0u;
    for (; group < view.groups; group++) {
        if !is_open(through, index) {
            opaque_enough = true;
            break;
        }
        var slabs: array<vec4<f32>, SLABS>;
        for (var j = 0u; j < SLABS; j++) {
            slabs[j] = vec4<f32>(0.0);
        }
        let first = f32((view.first_group + group) * SLABS);
        var next = starts[group * lists + number];
        let end = starts[group * lists + number + 1u];
        length_of_lists += end - next;
        loop {
            if next >= end {
                break;
            }
            let count = min(BATCH, end - next);
            workgroupBarrier();
            if index < count {
                batch[index] = balls[list[next + index]];
            }
            workgroupBarrier();
            var i = 0u;
            for (; i < count; i++) {
                // With c the centre over the radius, d its depth and dir = (X, Y, -1): A = d Y - c_y, B = c_x - d X,
                // b^2 = |c x dir|^2 / |dir|^2, and the point nearest the centre lies (X B - Y A)/|dir| beyond the ray's point at
                // the centre's depth.
                let offset = picture - batch[i].anchor;
                let b = along(batch[i].x, offset.x);
                let a = along(batch[i].y, offset.y);
                let twist = across(batch[i].both, offset);
                let square = (a * a + b * b + twist * twist) / length_squared;
                if square < 1.0 {
                    let closest = (tangent.x * b - tangent.y * a) / length;
                    let reach = sqrt(1.0 - square);
                    let start = min(max(-reach, batch[i].near * length - closest), reach);
                    let surface = (behind.w - batch[i].depth) * batch[i].inverse * length - closest;
                    let stop = max(min(reach, surface), start);
                    let plane = fma(first, batch[i].step, batch[i].plane);
                    let amplitude = batch[i].amplitude;
                    // The first plane of all and the last part nothing: rounding must leave no gas before or behind them.
                    let u = select(clamp(plane * length - closest, start, stop), start, first == 0.0);
                    let before = primitive(i, square, u);
                    // Written out: a loop here would count eightfold where a driver ends long ones.
                    let ray = Ray(square, length, closest, stop, i, vec4<f32>(amplitude, amplitude * batch[i].color), batch[i].step, plane);
                    var front = vec2<f32>(u, before);
                    slabs[0] += segment(ray, 1u, u32(first), &front);
                    slabs[1] += segment(ray, 2u, u32(first), &front);
                    slabs[2] += segment(ray, 3u, u32(first), &front);
                    slabs[3] += segment(ray, 4u, u32(first), &front);
                    slabs[4] += segment(ray, 5u, u32(first), &front);
                    slabs[5] += segment(ray, 6u, u32(first), &front);
                    slabs[6] += segment(ray, 7u, u32(first), &front);
                    slabs[7] += segment(ray, 8u, u32(first), &front);
                }
            }
            composited += i;
            next += count;
        }
        for (var j = 0u; j < SLABS; j++) {
            if (HALF != 0.0 || ESTIMATE) && (j & 1u) == 0u {
                // Two slabs as one.
                let both = slabs[j] + slabs[j + 1u];
                if both.x > LEAST {
                    light = fma(vec3<f32>(HALF * through * opacity(both.x) / both.x), both.yzw, light);
                    off = fma(vec3<f32>(OFF.y * through * opacity(both.x) / both.x), both.yzw, off);
                }
            }
            if ESTIMATE && OFF.z != 0.0 && (j & 3u) == 0u {
                // Four.
                let all = (slabs[j] + slabs[j + 1u]) + (slabs[j + 2u] + slabs[j + 3u]);
                if all.x > LEAST {
                    off = fma(vec3<f32>(OFF.z * through * opacity(all.x) / all.x), all.yzw, off);
                }
            }
            let depth = slabs[j].x;
            if depth > LEAST {
                let share = through * opacity(depth);
                light = fma(vec3<f32>(FULL * share / depth), slabs[j].yzw, light);
                off = fma(vec3<f32>(OFF.x * share / depth), slabs[j].yzw, off);
                through -= share;
            }
        }
        workgroupBarrier();
    }

    if inside {
        write_pixel(place, light, through, behind);
        write_off(place, off);
    }
    count_tile(index, composited, opaque_enough || (group == view.groups && composited == length_of_lists));
}
