// Pairs of tile and element, in the order of the elements: an invocation for each pair, four in turn, so that large elements take no
// longer than small ones.

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> spans: array<vec2<u32>>;
// Pairs before each element, and all of them.
@group(0) @binding(3) var<storage, read> ends: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys: array<u32>;
@group(0) @binding(5) var<storage, read_write> values: array<u32>;

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
        let element = order[low];
        let span = spans[element];
        let number = pair - ends[low];
        let wide = tiles(span.x);
        let tile = vec2<u32>(first(span.x) + number % wide, first(span.y) + number / wide);
        keys[pair] = element / work.particles * work.stride + tile.y * work.across + tile.x;
        values[pair] = element;
    }
}
