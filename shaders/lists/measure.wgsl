// The number of tiles that each element reaches into, in order; one more at the end, 0, for the sum of all.

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> spans: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> lengths: array<u32>;

@compute @workgroup_size(256)
fn measure(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < work.count {
        let span = spans[order[id.x]];
        lengths[id.x] = tiles(span.x) * tiles(span.y);
    } else if id.x == work.count {
        lengths[id.x] = 0u;
    }
}
