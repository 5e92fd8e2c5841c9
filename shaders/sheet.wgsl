// One workgroup goes through the slices of one tile, front to back, eight at a time in registers: each holds the opacities of its
// segments added up, and those times the colours; see src/render/method/sheet.rs. The lists are per tile and eight slices.

const BATCH: u32 = 64u;
const SLICES: u32 = 8u;

@group(0) @binding(1) var<storage, read> discs: array<Disc>;

var<workgroup> batch: array<Disc, BATCH>;

// A pixel on a disc: the disc's place in the batch, its place in the table, what is behind an opaque surface cut off (signed
// distance from the centre), the optical depth through the centre times the colour, and that alone.
struct Line {
    disc: u32,
    place: vec2<f32>,
    surface: f32,
    content: vec4<f32>,
}

// Signed distance from the centre of the plane behind a slice, within the ball. By one formula, so that a plane is the same for
// the slices before and behind it.
fn plane_behind(disc: u32, slice: i32) -> f32 {
    let number = f32(slice - i32(batch[disc].first));
    return clamp(fma(number, batch[disc].step, batch[disc].plane), batch[disc].start, 1.0);
}

// What lies in a slice behind `front` (signed distance from the centre, and S there), which becomes its back.
fn segment(line: Line, slice: i32, front: ptr<function, vec2<f32>>) -> vec4<f32> {
    let to = min(plane_behind(line.disc, slice), line.surface);
    if !(to > (*front).x) {
        return vec4<f32>(0.0);
    }
    let value = values(batch[line.disc].table, batch[line.disc].segments, line.place, to);
    // Rounding must leave no less than nothing.
    let share = max(value - (*front).y, 0.0);
    *front = vec2<f32>(to, value);
    return line.content * share;
}

@compute @workgroup_size(16, 16)
fn composite_tile(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let at = tile.xy * TILE + local.xy;
    let inside = all(at < view.size);
    let pixel = at.y * view.size.x + at.x;
    let picture = vec2<f32>(vec2<u32>(at.x, at.y + view.first_row));

    let behind = behind_gas(inside, pixel);
    let before = so_far(inside, pixel);
    var light = before.rgb;
    var through = before.a;

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
        var slices: array<vec4<f32>, SLICES>;
        for (var j = 0u; j < SLICES; j++) {
            slices[j] = vec4<f32>(0.0);
        }
        let first = i32((view.first_group + group) * SLICES);
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
                batch[index] = discs[list[next + index]];
            }
            workgroupBarrier();
            var i = 0u;
            for (; i < count; i++) {
                let offset = picture - batch[i].anchor;
                let a = along(batch[i].x, offset.x);
                let b = along(batch[i].y, offset.y);
                let square = fma(a, a, b * b);
                if square < 1.0 {
                    let surface = (behind.w - batch[i].depth) * batch[i].inverse;
                    let content = batch[i].thickness * vec4<f32>(batch[i].color, 1.0);
                    let line = Line(i, place(square), surface, content);
                    let start = plane_behind(i, first - 1);
                    var front = vec2<f32>(start, 0.0);
                    if start > -1.0 {
                        front.y = values(batch[i].table, batch[i].segments, line.place, start);
                    }
                    // Written out: a loop here would count eightfold where a driver ends long ones.
                    slices[0] += segment(line, first, &front);
                    slices[1] += segment(line, first + 1, &front);
                    slices[2] += segment(line, first + 2, &front);
                    slices[3] += segment(line, first + 3, &front);
                    slices[4] += segment(line, first + 4, &front);
                    slices[5] += segment(line, first + 5, &front);
                    slices[6] += segment(line, first + 6, &front);
                    slices[7] += segment(line, first + 7, &front);
                }
            }
            composited += i;
            next += count;
        }
        for (var j = 0u; j < SLICES; j++) {
            // An opacity above 1 becomes 1, and the colour is scaled with it.
            let sum = slices[j].w;
            light = fma(vec3<f32>(through / max(sum, 1.0)), slices[j].rgb, light);
            through = fma(-through, min(sum, 1.0), through);
        }
        workgroupBarrier();
    }

    if inside {
        write_pixel(pixel, light, through, behind);
    }
    count_tile(index, composited, opaque_enough || (group == view.groups && composited == length_of_lists));
}
