// Adds to each element what is before its block of 1024.

@group(0) @binding(1) var<storage, read_write> values: array<u32>;
@group(0) @binding(2) var<storage, read> sums: array<u32>;

@compute @workgroup_size(256)
fn spread(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < work.count {
        values[id.x] = min(values[id.x] + sums[id.x / 1024u], 0x7fffffffu);
    }
}
