//! Number types of binary files, and their decoding into f64.

use super::columns::{number, quote};
use half::f16;

/// A number type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    /// IEEE 754 half precision.
    F16,
    F32,
    F64,
    /// A byte that is 0 for false, 1 for true; read as these numbers.
    Bool,
}

impl Scalar {
    /// Bytes in a binary file.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 | Self::Bool => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The smallest and largest value of an integer type.
    pub fn range(self) -> Option<[f64; 2]> {
        match self {
            Self::I8 => Some([i8::MIN.into(), i8::MAX.into()]),
            Self::U8 => Some([u8::MIN.into(), u8::MAX.into()]),
            Self::I16 => Some([i16::MIN.into(), i16::MAX.into()]),
            Self::U16 => Some([u16::MIN.into(), u16::MAX.into()]),
            Self::I32 => Some([i32::MIN.into(), i32::MAX.into()]),
            Self::U32 => Some([u32::MIN.into(), u32::MAX.into()]),
            // The largest integers below 2^63 and 2^64 that an f64 holds.
            Self::I64 => Some([i64::MIN as f64, 9_223_372_036_854_774_784.0]),
            Self::U64 => Some([0.0, 18_446_744_073_709_549_568.0]),
            Self::Bool => Some([0.0, 1.0]),
            Self::F16 | Self::F32 | Self::F64 => None,
        }
    }

    /// Appends the value at `offset` of every `stride` bytes of `block`. `stride` > 0 divides the block's length.
    pub fn decode<const BIG: bool>(self, block: &[u8], stride: usize, offset: usize, out: &mut Vec<f64>) {
        match self {
            Self::I8 => decode::<1, BIG>(block, stride, offset, out, |b| i8::from_le_bytes(b).into()),
            Self::U8 => decode::<1, BIG>(block, stride, offset, out, |b| u8::from_le_bytes(b).into()),
            Self::I16 => decode::<2, BIG>(block, stride, offset, out, |b| i16::from_le_bytes(b).into()),
            Self::U16 => decode::<2, BIG>(block, stride, offset, out, |b| u16::from_le_bytes(b).into()),
            Self::I32 => decode::<4, BIG>(block, stride, offset, out, |b| i32::from_le_bytes(b).into()),
            Self::U32 => decode::<4, BIG>(block, stride, offset, out, |b| u32::from_le_bytes(b).into()),
            Self::I64 => decode::<8, BIG>(block, stride, offset, out, |b| i64::from_le_bytes(b) as f64),
            Self::U64 => decode::<8, BIG>(block, stride, offset, out, |b| u64::from_le_bytes(b) as f64),
            Self::F16 => decode::<2, BIG>(block, stride, offset, out, |b| f16::from_le_bytes(b).into()),
            Self::F32 => decode::<4, BIG>(block, stride, offset, out, |b| f32::from_le_bytes(b).into()),
            Self::F64 => decode::<8, BIG>(block, stride, offset, out, f64::from_le_bytes),
            Self::Bool => decode::<1, BIG>(block, stride, offset, out, |[b]| f64::from(u8::from(b != 0))),
        }
    }

    /// The number that a field of text spells, if the type can hold it.
    pub fn parse(self, field: &[u8]) -> Result<f64, String> {
        let value = number(field)?;
        match self.range() {
            Some([min, max]) if value.fract() != 0.0 || value < min || value > max => {
                Err(format!("{} is out of range; allowed: an integer from {min} to {max}", quote(field)))
            }
            _ => Ok(value),
        }
    }
}

fn decode<const N: usize, const BIG: bool>(
    block: &[u8],
    stride: usize,
    offset: usize,
    out: &mut Vec<f64>,
    value: impl Fn([u8; N]) -> f64,
) {
    out.extend(block.chunks_exact(stride).map(|row| {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&row[offset..offset + N]);
        if BIG {
            bytes.reverse();
        }
        value(bytes)
    }));
}
