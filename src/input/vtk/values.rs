//! From the bytes or words of one of VTK's arrays to the values of its wanted components.

use super::table::{Group, Table};
use crate::input::columns::{ReadError, number, quote, reserve};
use crate::input::scalar::Scalar;

/// Values to reserve at once where the size of the file is unknown and a count cannot be checked.
const CAUTIOUS: usize = 1 << 16;

/// What an array holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Bits, packed from the highest of each byte on without regard to tuples.
    Bit,
    /// Numbers.
    Number(Scalar),
    /// Text alone: numbers from 0 to 1 that stand for bytes from 0 to 255.
    Share,
}

impl Kind {
    /// Whether the values are unsigned 8-bit integers.
    pub fn is_byte(self) -> bool {
        matches!(self, Self::Number(Scalar::U8) | Self::Share)
    }

    /// Bytes that so many values take in a binary file.
    pub fn bytes(self, values: u64) -> u64 {
        match self {
            Self::Bit => values.div_ceil(8),
            Self::Number(scalar) => values.saturating_mul(scalar.size() as u64),
            Self::Share => values,
        }
    }

    /// The number that a word spells, rounded as the type has it, so that text and binary data give the same.
    fn parse(self, word: &[u8]) -> Result<f64, String> {
        let text = std::str::from_utf8(word).unwrap_or_default();
        match self {
            Self::Bit => match text {
                "0" => Ok(0.0),
                "1" => Ok(1.0),
                _ => Err(format!("{} is no bit; allowed: 0 or 1", quote(word))),
            },
            // A detour through f64 would refuse the largest of them.
            Self::Number(scalar @ Scalar::I64) => {
                text.parse::<i64>().map(|value| value as f64).or_else(|_| scalar.parse(word))
            }
            Self::Number(scalar @ Scalar::U64) => {
                text.parse::<u64>().map(|value| value as f64).or_else(|_| scalar.parse(word))
            }
            Self::Number(Scalar::F32) => match text.parse::<f32>() {
                Ok(value) if value.is_finite() => Ok(value.into()),
                _ => {
                    let value = number(word)?;
                    Err(format!("{value:e} does not fit a float; allowed: at most {:e}", f32::MAX))
                }
            },
            Self::Number(scalar) => scalar.parse(word),
            Self::Share => match number(word)? {
                value if (0.0..=1.0).contains(&value) => Ok((255.0 * value + 0.5).floor()),
                _ => Err(format!("{} is out of range; allowed: a number from 0 to 1", quote(word))),
            },
        }
    }
}

/// Takes the data of one array and keeps the wanted components.
pub struct Sink {
    name: String,
    kind: Kind,
    big: bool,
    lenient: bool,
    components: usize,
    /// Component, index of its column, values so far, of which the first are of other arrays.
    outputs: Vec<(usize, usize, Vec<f64>)>,
    /// Values of all components still to come.
    left: u64,
    /// Number of the tuple, among the array's own, that comes next.
    tuple: u64,
    /// Component that comes next, of words and bits.
    component: usize,
    /// Index of the output that is wanted next: outputs are sorted by their components.
    next: usize,
    /// The beginning of a tuple.
    carry: Vec<u8>,
    /// Byte of the file at which the data begin, where they are there as they are.
    origin: Option<u64>,
}

impl Sink {
    /// For `tuples` tuples of an array. The values go behind those that `values` returns for a column; room is made for
    /// all of them if `checked`, which is to say that their number is no more than the size of the file allows.
    pub fn new(
        group: &Group,
        kind: Kind,
        big: bool,
        tuples: u64,
        lenient: bool,
        checked: bool,
        mut values: impl FnMut(usize) -> Vec<f64>,
    ) -> Result<Self, ReadError> {
        let mut outputs = Vec::with_capacity(group.wanted.len());
        for &(component, column) in &group.wanted {
            let mut values = values(column);
            let room = usize::try_from(tuples).unwrap_or(usize::MAX);
            reserve(&mut values, if checked { room } else { room.min(CAUTIOUS) })?;
            outputs.push((component, column, values));
        }
        Ok(Self {
            name: group.name.clone(),
            kind,
            big,
            lenient,
            components: group.components.max(1),
            outputs,
            left: tuples.saturating_mul(group.components as u64),
            tuple: 0,
            component: 0,
            next: 0,
            carry: Vec::new(),
            origin: None,
        })
    }

    /// Where in the file the data begin, for messages.
    pub fn starting_at(mut self, byte: u64) -> Self {
        self.origin = Some(byte);
        self
    }

    /// Bytes to push at once: whole tuples, about `wish` bytes.
    pub fn block(&self, wish: usize) -> usize {
        match self.kind {
            Kind::Number(scalar) => {
                let stride = self.components * scalar.size();
                (wish / stride).max(1) * stride
            }
            Kind::Bit | Kind::Share => wish,
        }
    }

    /// Takes the next bytes of binary data; no more than the tuples have.
    pub fn push(&mut self, mut bytes: &[u8]) -> Result<(), String> {
        let scalar = match self.kind {
            Kind::Number(scalar) => scalar,
            Kind::Bit | Kind::Share => {
                self.push_bits(bytes);
                return Ok(());
            }
        };
        let stride = self.components * scalar.size();
        if !self.carry.is_empty() {
            let (head, rest) = bytes.split_at((stride - self.carry.len()).min(bytes.len()));
            self.carry.extend_from_slice(head);
            bytes = rest;
            if self.carry.len() < stride {
                return Ok(());
            }
            let tuple = std::mem::take(&mut self.carry);
            self.decode(scalar, stride, &tuple)?;
        }
        let (whole, rest) = bytes.split_at(bytes.len() / stride * stride);
        self.decode(scalar, stride, whole)?;
        self.carry.extend_from_slice(rest);
        Ok(())
    }

    fn decode(&mut self, scalar: Scalar, stride: usize, block: &[u8]) -> Result<(), String> {
        for (component, _, values) in &mut self.outputs {
            let (before, offset) = (values.len(), *component * scalar.size());
            if self.big {
                scalar.decode::<true>(block, stride, offset, values);
            } else {
                scalar.decode::<false>(block, stride, offset, values);
            }
            if scalar.range().is_some() {
                continue;
            }
            for (row, value) in values.iter_mut().skip(before).enumerate().filter(|(_, value)| !value.is_finite()) {
                if !self.lenient {
                    let tuple = self.tuple + row as u64;
                    let place = match self.origin {
                        Some(origin) => format!("byte {}: ", origin + tuple * stride as u64 + offset as u64),
                        None => String::new(),
                    };
                    return Err(format!(
                        "{place}component {component} of point {tuple} in array `{}` is {value}; allowed: a finite number",
                        self.name
                    ));
                }
                *value = f64::NAN;
            }
        }
        self.tuple += (block.len() / stride) as u64;
        Ok(())
    }

    fn push_bits(&mut self, bytes: &[u8]) {
        for byte in bytes {
            for bit in (0..8).rev() {
                if self.left > 0 {
                    self.value(f64::from(byte >> bit & 1));
                }
            }
        }
    }

    /// Takes the next word of text; no more than the tuples have.
    pub fn word(&mut self, word: &[u8]) -> Result<(), String> {
        // What nobody wants may be anything.
        let wanted = self.outputs.get(self.next).is_some_and(|output| output.0 == self.component);
        let value = match wanted.then(|| self.kind.parse(word)) {
            None => 0.0,
            Some(Ok(value)) => value,
            Some(Err(_)) if self.lenient => f64::NAN,
            Some(Err(problem)) => {
                let (component, tuple) = (self.component, self.tuple);
                return Err(format!("component {component} of point {tuple} in array `{}`: {problem}", self.name));
            }
        };
        self.value(value);
        Ok(())
    }

    fn value(&mut self, value: f64) {
        if let Some((component, _, values)) = self.outputs.get_mut(self.next)
            && *component == self.component
        {
            values.push(value);
            self.next += 1;
        }
        self.left = self.left.saturating_sub(1);
        self.component += 1;
        if self.component == self.components {
            self.component = 0;
            self.next = 0;
            self.tuple += 1;
        }
    }

    /// Number of values held, those of other arrays included.
    pub fn held(&self) -> u64 {
        self.outputs.iter().map(|(_, _, values)| values.len() as u64).sum()
    }

    /// The values, with the indices of their columns.
    pub fn finish(self) -> impl Iterator<Item = (usize, Vec<f64>)> {
        self.outputs.into_iter().map(|(_, column, values)| (column, values))
    }

    /// Gives the values back to the table they were taken from.
    pub fn give_back(self, table: &mut Table) {
        for (column, values) in self.finish() {
            table.put(column, values);
        }
    }
}
