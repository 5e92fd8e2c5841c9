// Where the list of each tile begins among the sorted pairs: the first key that is not below the tile's.

@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(256)
fn begin(@builtin(global_invocation_id) id: vec3<u32>) {
    // `blocks`: here the number of keys, those of all tiles of all views and of their ends.
    if id.x >= work.blocks {
        return;
    }
    var low = 0u;
    var high = work.count;
    while low < high {
        let middle = low + (high - low) / 2u;
        if keys[middle] < id.x {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    starts[id.x] = low;
}
