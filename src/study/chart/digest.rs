//! A short name for a long content.

use std::fmt::{self, Debug, Write};

/// FNV-1a of 64 bits (Fowler, Noll & Vo) over text: the same on every machine and, unlike the standard library's hashes,
/// with every release of the compiler.
struct Digest(u64);

impl Write for Digest {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        Ok(())
    }
}

/// 16 hexadecimal digits that stand for a content. The text that `Debug` derives names every field, those added later too,
/// and writes each number with all its digits.
pub fn digest(content: &dyn Debug) -> String {
    let mut digest = Digest(0xcbf2_9ce4_8422_2325);
    // Writing to it cannot fail.
    let _ = write!(digest, "{content:?}");
    format!("{:016x}", digest.0)
}
