// Which tiles an element reaches into: rows of tiles in steps of the same height, the last of what is left, with the columns of
// each. First and last 16 bits each; the last before the first: none. Twin of `Stairs` in src/render/gpu/bin.rs.

const STEPS: u32 = 16u;
const NOWHERE: u32 = 1u;

struct Stairs {
    rows: u32,
    // Those beyond the rows mean nothing.
    columns: array<u32, STEPS>,
}

fn first(span: u32) -> u32 {
    return span & 0xffffu;
}

fn tiles(span: u32) -> u32 {
    return (span >> 16u) + 1u - first(span);
}

// Rows of a step.
fn step_height(rows: u32) -> u32 {
    return (tiles(rows) + STEPS - 1u) / STEPS;
}
