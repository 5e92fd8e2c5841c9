// Which tiles an element reaches into: first and last column, first and last row, 16 bits each; the last before the first: none.

fn first(word: u32) -> u32 {
    return word & 0xffffu;
}

fn tiles(word: u32) -> u32 {
    return (word >> 16u) + 1u - first(word);
}
