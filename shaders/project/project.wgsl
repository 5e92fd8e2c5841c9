// Particles as their views see them: what the tile shader reads of them, the tiles that they reach into, and their place in the order.
// Twin of src/render/cpu/splat.rs and of the methods' `prepare` and `forms`, which are in f64.

// A particle of the scene, about the scene's middle; high and low parts.
struct Particle {
    high: vec3<f32>,
    radius: f32,
    low: vec3<f32>,
    radius_low: f32,
    color: vec3<f32>,
    // As in Splat; 0: not shown.
    amplitude: f32,
}

// Particles that share a kernel, from `start` to that of the next: as in Splat.
struct Kind {
    start: u32,
    table: u32,
    intervals: f32,
}

// A view. Vectors have their high and low parts in turn.
struct Eye {
    // About the scene's middle.
    position: array<vec4<f32>, 2>,
    // World-space directions of eye-space x and y and of depth.
    right: array<vec4<f32>, 2>,
    up: array<vec4<f32>, 2>,
    forward: array<vec4<f32>, 2>,
    // Tangents of the ray through the centre of pixel (0, 0), and their change per pixel: x high, x low, y high, y low.
    tangent: vec4<f32>,
    step: vec4<f32>,
    // Pixels per unit of tangent, and picture coordinates of tangent (0, 0).
    focal: vec2<f32>,
    center: vec2<f32>,
}

struct Projection {
    eyes: array<Eye, 2>,
    // High and low part.
    near: vec2<f32>,
    // A depth so close to that of the near plane is not told from it.
    hair: f32,
    // 0; see double.wgsl.
    nothing: u32,
    // Of the picture.
    size: vec2<u32>,
    // First row, and that after the last.
    rows: vec2<u32>,
    // Number of particles, of views, and of kinds.
    particles: u32,
    views: u32,
    kinds: u32,
    // 1 in the linear opacity model.
    linear: u32,
    // Number of views with keys of their own: 1 where all share those of the first.
    orders: u32,
}

// A particle in eye space, depth instead of z.
struct Body {
    x: vec2<f32>,
    y: vec2<f32>,
    depth: vec2<f32>,
    radius: vec2<f32>,
}

// Intervals of picture coordinates that hold what a particle shows, grown by more than rounding can take; and as in Splat.
struct Cover {
    x: vec2<f32>,
    y: vec2<f32>,
    front: f32,
}

// The ellipse that a particle shows nothing beyond, in picture coordinates: `Rim` in src/render/cpu/rim.rs.
struct Rim {
    center: vec2<f32>,
    half: vec2<f32>,
    turn: f32,
    slack: f32,
}

// What a ball and the ray through the anchor have in common: the components of c x dir over the radius, c . dir, and the ray.
struct Meeting {
    tangent: vec4<f32>,
    // (x - d X, d Y - y, x Y - y X) / r.
    cross: vec3<f32>,
    ahead: f32,
    // Change of the tangents per pixel.
    step: vec2<f32>,
}

@group(0) @binding(0) var<uniform> projection: Projection;
@group(0) @binding(1) var<storage, read> particles: array<Particle>;
@group(0) @binding(2) var<storage, read> kinds: array<Kind>;
// Element v * particles + i is particle i as view v sees it.
@group(0) @binding(3) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(4) var<storage, read_write> stairs: array<Stairs>;
// The order's keys: single precision of the measure, and 16 bits of what that leaves; the last element first, since the lower of
// equals is farther. Views that share depth have one key for all: that of the first.
@group(0) @binding(5) var<storage, read_write> high: array<u32>;
@group(0) @binding(6) var<storage, read_write> low: array<u32>;
@group(0) @binding(7) var<storage, read_write> order: array<u32>;
// Elements that are seen, and those that may be before or behind the near plane.
@group(0) @binding(8) var<storage, read_write> found: array<atomic<u32>, 2>;

const FARTHEST: f32 = 3.4028234e38;
// Tangent of what is behind the eye.
const SIDEWAYS: f32 = 1e12;

// Bits that ascend with the value.
fn ascending(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

// What is left of a number beside its high part, in 2^-16 of the high part's last bit.
fn remainder(value: vec2<f32>) -> u32 {
    let power = bitcast<f32>(bitcast<u32>(value.x) & 0x7f800000u);
    if power == 0.0 {
        return 32768u;
    }
    let last = value.y / power * 8388608.0;
    return u32(clamp((last + 0.5) * 65536.0, 0.0, 65535.0));
}

fn less2(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    return plus2(a, -b);
}

fn dot2(a: array<vec4<f32>, 2>, x: vec2<f32>, y: vec2<f32>, z: vec2<f32>) -> vec2<f32> {
    let first = times2(vec2<f32>(a[0].x, a[1].x), x);
    let second = times2(vec2<f32>(a[0].y, a[1].y), y);
    return plus2(plus2(first, second), times2(vec2<f32>(a[0].z, a[1].z), z));
}

fn seen(particle: Particle, eye: Eye) -> Body {
    let x = less2(vec2<f32>(particle.high.x, particle.low.x), vec2<f32>(eye.position[0].x, eye.position[1].x));
    let y = less2(vec2<f32>(particle.high.y, particle.low.y), vec2<f32>(eye.position[0].y, eye.position[1].y));
    let z = less2(vec2<f32>(particle.high.z, particle.low.z), vec2<f32>(eye.position[0].z, eye.position[1].z));
    let radius = vec2<f32>(particle.radius, particle.radius_low);
    return Body(dot2(eye.right, x, y, z), dot2(eye.up, x, y, z), dot2(eye.forward, x, y, z), radius);
}

fn distance_squared(body: Body) -> vec2<f32> {
    return plus2(plus2(times2(body.x, body.x), times2(body.y, body.y)), times2(body.depth, body.depth));
}

// Picture coordinates of an interval of tangents along x or, turned over, along y; `slack` in tangents.
fn across_picture(eye: Eye, tangents: vec2<f32>, slack: vec2<f32>) -> vec2<f32> {
    let grown = vec2<f32>(tangents.x - slack.x, tangents.y + slack.y);
    return vec2<f32>(eye.center.x) + grown * eye.focal.x + vec2<f32>(-0.01, 0.01);
}

fn down_picture(eye: Eye, tangents: vec2<f32>, slack: vec2<f32>) -> vec2<f32> {
    let grown = vec2<f32>(tangents.x - slack.x, tangents.y + slack.y);
    return vec2<f32>(eye.center.y) - grown.yx * eye.focal.y + vec2<f32>(-0.01, 0.01);
}

// A disc parallel to the view plane at depth `at`, or the square around it: Card::new.
fn cover_card(body: Body, at: f32, eye: Eye) -> Cover {
    let x = vec2<f32>(body.x.x - body.radius.x, body.x.x + body.radius.x) / at;
    let y = vec2<f32>(body.y.x - body.radius.x, body.y.x + body.radius.x) / at;
    let slack = 1e-6 * (vec2<f32>(abs(body.x.x), abs(body.y.x)) + body.radius.x) / at;
    return Cover(across_picture(eye, x, slack.xx), down_picture(eye, y, slack.yy), -FARTHEST);
}

// An end of the interval of tangents that a circle covers: tangent_interval. Directions that nearly point sideways do.
fn edge(side: f32, across: f32, depth: f32, radius: f32, root: f32) -> f32 {
    let along = depth * root - side * across * radius;
    let far = depth * depth + across * across;
    if !(along > 1e-6 * far) {
        return side * SIDEWAYS;
    }
    return (across * root + side * depth * radius) / along;
}

// The tangents along one axis that a ball covers beyond the near plane, grown: the first half of Lens::ball_intervals.
fn tangents(across: vec2<f32>, body: Body) -> vec2<f32> {
    let depth = body.depth.x;
    let radius = body.radius.x;
    if depth > 0.0 {
        let squares = plus2(times2(across, across), times2(body.depth, body.depth));
        let outside = less2(squares, times2(body.radius, body.radius)).x;
        if !(outside > 0.0) {
            return vec2<f32>(-SIDEWAYS, SIDEWAYS);
        }
        let root = sqrt(outside);
        let ends = vec2<f32>(edge(-1.0, across.x, depth, radius, root), edge(1.0, across.x, depth, radius, root));
        // An angle is rounded, so much the more a tangent.
        let slack = 2e-6 * (1.0 + ends * ends);
        return select(ends + vec2<f32>(-1.0, 1.0) * slack, ends, abs(ends) >= vec2<f32>(SIDEWAYS));
    }
    let far = plus2(body.depth, body.radius).x;
    let near = projection.near.x;
    let ends = vec2<f32>(across.x - radius, across.x + radius);
    let slack = vec2<f32>(2e-6 * (abs(across.x) + radius));
    let grown = ends + vec2<f32>(-1.0, 1.0) * slack;
    // What lies behind the far point by rounding alone is not there.
    let reach = max(far, near);
    return grown / vec2<f32>(select(reach, near, grown.x < 0.0), select(reach, near, grown.y > 0.0));
}

// The part of a ball behind the near plane: Lens::ball_bounds.
fn cover_body(body: Body, eye: Eye) -> Cover {
    let none = vec2<f32>(0.0);
    return Cover(across_picture(eye, tangents(body.x, body), none), down_picture(eye, tangents(body.y, body), none), -FARTHEST);
}

// Beyond everything.
fn no_rim() -> Rim {
    return Rim(vec2<f32>(0.0), vec2<f32>(1e30), 0.0, 0.0);
}

fn rim_of(eye: Eye, middle: vec2<f32>, half: vec2<f32>, turn: f32) -> Rim {
    let away = vec2<f32>(middle.x, -middle.y) * eye.focal;
    let far = abs(away) + half * eye.focal + 0.1 * abs(eye.center);
    return Rim(eye.center + away, half * eye.focal, turn, 0.1 + 1e-5 * (far.x + far.y));
}

// Of a disc parallel to the view plane at depth `at`: Rim::card.
fn card_rim(body: Body, at: f32, eye: Eye) -> Rim {
    return rim_of(eye, vec2<f32>(body.x.x, body.y.x) / at, vec2<f32>(body.radius.x / at), 0.0);
}

// Of a ball with the square of a radius: Rim::ball. Lengths in depths, so that no square is beyond single precision.
fn ball_rim(body: Body, eye: Eye, square: f32) -> Rim {
    let beyond = 1.0 - square;
    if !(body.depth.x > 0.0 && beyond > 0.1) {
        return no_rim();
    }
    let c = vec2<f32>(body.x.x, body.y.x) / body.depth.x;
    let squares = c * c + beyond;
    let half = sqrt(square) / beyond * sqrt(squares);
    // Rows count downwards.
    return rim_of(eye, c / beyond, half, -(c.x / sqrt(squares.x)) * (c.y / sqrt(squares.y)));
}

fn body_rim(body: Body, eye: Eye) -> Rim {
    let radius = body.radius.x / body.depth.x;
    return ball_rim(body, eye, radius * radius);
}

// Of a disc that faces the eye: Rim::facing.
fn facing_rim(body: Body, eye: Eye) -> Rim {
    let c = vec3<f32>(body.x.x, body.y.x, body.depth.x) / body.depth.x;
    let radius = body.radius.x / body.depth.x;
    let far = dot(c, c);
    return ball_rim(body, eye, radius * radius * (far / (far + radius * radius)));
}

// What is within a rim between two heights, along x; grown: Rim::columns.
fn between(rim: Rim, heights: vec2<f32>) -> vec2<f32> {
    let grown = heights + vec2<f32>(-rim.slack, rim.slack);
    let v = (grown - rim.center.y) / rim.half.y;
    if v.x > 1.0 || v.y < -1.0 {
        return vec2<f32>(1.0, -1.0);
    }
    let ends = clamp(vec2<f32>(-rim.turn, rim.turn), vec2<f32>(max(v.x, -1.0)), vec2<f32>(min(v.y, 1.0)));
    let root = sqrt(max(1.0 - rim.turn * rim.turn, 0.0)) * sqrt(max(vec2<f32>(1.0) - ends * ends, vec2<f32>(0.0)));
    let u = rim.turn * ends + vec2<f32>(-root.x, root.y);
    return rim.center.x + rim.half.x * u + vec2<f32>(-rim.slack, rim.slack);
}

// Writes the tiles within a rim among those of columns and rows, first and last: Stairs::new.
fn write_stairs(element: u32, rim: Rim, columns: vec2<u32>, rows: vec2<u32>) {
    let span = rows.x | (rows.y << 16u);
    stairs[element].rows = span;
    let height = step_height(span);
    var row = rows.x;
    for (var i = 0u; row <= rows.y; i++) {
        let last = min(row + height - 1u, rows.y);
        let pixels = vec2<f32>(vec2<u32>(row * 16u, last * 16u + 15u) + projection.rows.x) + 0.5;
        let reach = between(rim, pixels);
        // First and after the last; clamped to what conversions can take.
        let ends = clamp(vec2<f32>(ceil(reach.x - 0.5), floor(reach.y + 0.5)), vec2<f32>(0.0), vec2<f32>(1e6));
        let start = max(u32(ends.x) / 16u, columns.x);
        let end = min(max(u32(ends.y), 1u) - 1u, columns.y * 16u + 15u) / 16u;
        stairs[element].columns[i] = select(NOWHERE, start | (end << 16u), ends.y > 0.0 && start <= end);
        row += height;
    }
}

// Pixels of an interval, first and after the last: Bounds::from_intervals.
fn pixels(interval: vec2<f32>, size: u32) -> vec2<u32> {
    let edges = clamp(interval + vec2<f32>(0.5), vec2<f32>(0.0), vec2<f32>(f32(size)));
    return vec2<u32>(edges);
}

fn tangent_at(eye: Eye, pixel: vec2<u32>) -> vec4<f32> {
    let x = plus2(eye.tangent.xy, times2(eye.step.xy, vec2<f32>(f32(pixel.x), 0.0)));
    let y = plus2(eye.tangent.zw, times2(eye.step.zw, vec2<f32>(f32(pixel.y), 0.0)));
    return vec4<f32>(x, y);
}

// `at`: the depth that the first two components take.
fn meet(body: Body, at: vec2<f32>, eye: Eye, pixel: vec2<u32>) -> Meeting {
    let tangent = tangent_at(eye, pixel);
    let b = less2(body.x, times2(at, tangent.xy)).x;
    let a = less2(times2(at, tangent.zw), body.y).x;
    let twist = less2(times2(body.x, tangent.zw), times2(body.y, tangent.xy)).x;
    let ahead = plus2(plus2(times2(body.x, tangent.xy), times2(body.y, tangent.zw)), body.depth).x;
    return Meeting(tangent, vec3<f32>(b, a, twist) / body.radius.x, ahead, vec2<f32>(eye.step.x, eye.step.z));
}

// The forms of a card at depth `at`: Card::offsets.
fn card_forms(body: Body, at: vec2<f32>, eye: Eye, pixel: vec2<u32>) -> Splat {
    let meeting = meet(body, at, eye, pixel);
    let step = at.x / body.radius.x * meeting.step;
    var splat = Splat();
    splat.x = vec2<f32>(-meeting.cross.x, step.x);
    splat.y = vec2<f32>(-meeting.cross.y, -step.y);
    return splat;
}

// The forms of an exact ball: perspective::Splat::forms.
fn body_forms(body: Body, eye: Eye, pixel: vec2<u32>) -> Splat {
    let meeting = meet(body, body.depth, eye, pixel);
    let c = vec3<f32>(body.x.x, body.y.x, body.depth.x) / body.radius.x;
    var splat = Splat();
    splat.x = vec2<f32>(meeting.cross.x, -c.z * meeting.step.x);
    splat.y = vec2<f32>(meeting.cross.y, c.z * meeting.step.y);
    splat.both = vec3<f32>(meeting.cross.z, -c.y * meeting.step.x, c.x * meeting.step.y);
    splat.ahead = vec3<f32>(meeting.ahead / body.radius.x, c.x * meeting.step.x, c.y * meeting.step.y);
    return splat;
}

fn kind_of(particle: u32) -> Kind {
    var below = 0u;
    var above = projection.kinds;
    while above - below > 1u {
        let middle = below + (above - below) / 2u;
        if kinds[middle].start <= particle {
            below = middle;
        } else {
            above = middle;
        }
    }
    return kinds[below];
}

@compute @workgroup_size(256)
fn project(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= projection.particles {
        return;
    }
    let element = id.y * projection.particles + i;
    let particle = particles[i];
    let eye = projection.eyes[id.y];
    let body = seen(particle, eye);
    // Seen or not: what is not seen is in no tile.
    if id.y < projection.orders {
        let place = projection.orders * projection.particles - 1u - element;
        let key = measure(body);
        order[place] = element;
        high[element] = ascending(key.x);
        low[place] = remainder(key);
    }
    stairs[element].rows = NOWHERE;
    if particle.amplitude == 0.0 {
        return;
    }
    var beyond = less2(body.depth, projection.near);
    if VOLUMETRIC {
        beyond = plus2(beyond, body.radius);
    } else if abs(beyond.x) <= projection.hair {
        atomicAdd(&found[1], 1u);
    }
    if !(beyond.x > 0.0) {
        return;
    }
    let covered = cover(body, eye);
    let columns = pixels(covered.x, projection.size.x);
    var rows = pixels(covered.y, projection.size.y);
    rows = vec2<u32>(max(rows.x, projection.rows.x), min(rows.y, projection.rows.y));
    if columns.x >= columns.y || rows.x >= rows.y {
        return;
    }
    atomicAdd(&found[0], 1u);
    let kind = kind_of(i);
    let within = vec4<u32>(columns.x, columns.y - 1u, rows.x - projection.rows.x, rows.y - 1u - projection.rows.x) / 16u;
    write_stairs(element, rim(body, eye, kind.intervals == 0.0), within.xy, within.zw);

    let anchor = vec2<u32>(columns.x + (columns.y - 1u - columns.x) / 2u, rows.x + (rows.y - 1u - rows.x) / 2u);
    var splat = forms(body, eye, anchor);
    splat.front = covered.front;
    splat.color = particle.color;
    splat.amplitude = particle.amplitude;
    splat.anchor = vec2<f32>(anchor);
    // Rounded so that the product never exceeds 1.
    splat.most = select(FARTHEST, 0.9999996 / particle.amplitude, projection.linear == 1u);
    splat.intervals = kind.intervals;
    splat.table = kind.table;
    splats[element] = splat;
}
