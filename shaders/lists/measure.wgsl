// The number of tiles that each element reaches into, in order, in all views that share the order; one more at the end, 0, for the
// sum of all.

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> stairs: array<Stairs>;
@group(0) @binding(3) var<storage, read_write> lengths: array<u32>;

@compute @workgroup_size(256)
fn measure(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < work.count {
        var length = 0u;
        for (var view = 0u; view < work.together; view++) {
            let element = order[id.x] + view * work.particles;
            let rows = stairs[element].rows;
            let height = step_height(rows);
            var left = tiles(rows);
            for (var number = 0u; left > 0u; number++) {
                let high = min(height, left);
                length += high * tiles(stairs[element].columns[number]);
                left -= high;
            }
        }
        lengths[id.x] = length;
    } else if id.x == work.count {
        lengths[id.x] = 0u;
    }
}
