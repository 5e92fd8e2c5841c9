// Counts the digits of a block of 1024 keys: the first half of a pass of a radix sort.

@group(0) @binding(1) var<storage, read> keys: array<u32>;
// Digit by digit, block by block.
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

var<workgroup> digits: array<atomic<u32>, 256>;

@compute @workgroup_size(256)
fn count(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    atomicStore(&digits[index], 0u);
    workgroupBarrier();
    for (var row = 0u; row < 4u; row++) {
        let at = block.x * 1024u + row * 256u + index;
        if at < work.count {
            // A sum: whoever comes first.
            atomicAdd(&digits[(keys[at] >> work.shift) & 255u], 1u);
        }
    }
    workgroupBarrier();
    counts[index * work.blocks + block.x] = atomicLoad(&digits[index]);
}
