// Pairs of tile and element, in the order of the elements: an invocation for each pair, four in turn, so that large elements take no
// longer than small ones.

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> stairs: array<Stairs>;
// Pairs before each element, and all of them.
@group(0) @binding(3) var<storage, read> ends: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> values: array<u32>;

// Element and tile of a pair, counted from the first of those that share the order: step by step, as measure.wgsl counts them.
fn place(shared_order: u32, pair: u32) -> vec3<u32> {
    var number = pair;
    for (var view = 0u; view < work.together; view++) {
        let element = shared_order + view * work.particles;
        let rows = stairs[element].rows;
        let height = step_height(rows);
        var row = first(rows);
        var left = tiles(rows);
        for (var i = 0u; left > 0u; i++) {
            let high = min(height, left);
            let columns = stairs[element].columns[i];
            let wide = tiles(columns);
            if number < high * wide {
                return vec3<u32>(element, first(columns) + number % wide, row + number / wide);
            }
            number -= high * wide;
            row += high;
            left -= high;
        }
    }
    // Never: there are as many pairs as tiles.
    return vec3<u32>(shared_order, 0u, 0u);
}

@compute @workgroup_size(256)
fn emit(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    for (var row = 0u; row < 4u; row++) {
        let pair = block.x * 1024u + row * 256u + index;
        if pair >= ends[work.count] {
            continue;
        }
        // The last element that begins at the pair or before it; those without tiles are before it.
        var low = 0u;
        var high = work.count;
        while high - low > 1u {
            let middle = low + (high - low) / 2u;
            if ends[middle] <= pair {
                low = middle;
            } else {
                high = middle;
            }
        }
        let found = place(order[low], pair - ends[low]);
        keys[pair] = found.x / work.particles * work.stride + found.z * work.across + found.y;
        values[pair] = found.x;
    }
}
