// Sums before each element within blocks of 1024, in place, and the blocks' sums. Sums stop at 2^31 - 1, which is told from every
// count that is allowed; so they are the same however they are put together.

@group(0) @binding(1) var<storage, read_write> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

var<workgroup> through: array<u32, 256>;

fn plus(a: u32, b: u32) -> u32 {
    return min(a + b, 0x7fffffffu);
}

@compute @workgroup_size(256)
fn scan(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let first = block.x * 1024u + index * 4u;
    var before: array<u32, 4>;
    var sum = 0u;
    for (var i = 0u; i < 4u; i++) {
        before[i] = sum;
        if first + i < work.count {
            sum = plus(sum, values[first + i]);
        }
    }
    through[index] = sum;
    workgroupBarrier();
    for (var reach = 1u; reach < 256u; reach *= 2u) {
        var below = 0u;
        if index >= reach {
            below = through[index - reach];
        }
        workgroupBarrier();
        through[index] = plus(through[index], below);
        workgroupBarrier();
    }
    var base = 0u;
    if index > 0u {
        base = through[index - 1u];
    }
    for (var i = 0u; i < 4u; i++) {
        if first + i < work.count {
            values[first + i] = plus(base, before[i]);
        }
    }
    if index == 255u {
        sums[block.x] = through[255];
    }
}
