// Moves a block of 1024 pairs to where their digits belong: the second half of a pass of a radix sort. Pairs of the same digit keep
// their order: each knows how many are before it from marks, one bit per pair, which are the same whoever sets them first.

@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
// Where the pairs of a digit and block go: the counts, summed.
@group(0) @binding(3) var<storage, read> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys_sorted: array<u32>;
@group(0) @binding(5) var<storage, read_write> values_sorted: array<u32>;

// Of 256 pairs at a time, those of a digit: eight words per digit, all first words first.
var<workgroup> marks: array<atomic<u32>, 2048>;
// Where the next pair of a digit goes.
var<workgroup> next: array<u32, 256>;

@compute @workgroup_size(256)
fn scatter(@builtin(workgroup_id) block: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    next[index] = places[index * work.blocks + block.x];
    for (var word = 0u; word < 8u; word++) {
        atomicStore(&marks[word * 256u + index], 0u);
    }
    let own = index / 32u;
    let bit = 1u << (index % 32u);
    for (var row = 0u; row < 4u; row++) {
        workgroupBarrier();
        let at = block.x * 1024u + row * 256u + index;
        let inside = at < work.count;
        var key = 0u;
        var digit = 0u;
        if inside {
            key = keys[at];
            digit = (key >> work.shift) & 255u;
            atomicOr(&marks[own * 256u + digit], bit);
        }
        workgroupBarrier();
        if inside {
            var place = next[digit] + countOneBits(atomicLoad(&marks[own * 256u + digit]) & (bit - 1u));
            for (var word = 0u; word < own; word++) {
                place += countOneBits(atomicLoad(&marks[word * 256u + digit]));
            }
            keys_sorted[place] = key;
            values_sorted[place] = values[at];
        }
        workgroupBarrier();
        // Every invocation looks after a digit.
        var found = 0u;
        for (var word = 0u; word < 8u; word++) {
            found += countOneBits(atomicExchange(&marks[word * 256u + index], 0u));
        }
        next[index] += found;
    }
}
