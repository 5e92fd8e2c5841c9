//! The header of a `.npy` file: a Python dictionary written out, of strings, integers, tuples, lists and truth values.
//!
//! It is never evaluated, only parsed, and only what [`Header`] needs is understood.

use crate::input::columns::{ReadError, quote};
use crate::input::scalar::Scalar;

/// Deepest nesting that is parsed; records within records take two levels each.
const MAX_DEPTH: usize = 16;

/// Longest name of a field, bytes: a sub-array repeats it for each of its columns.
const LONGEST_NAME: usize = 256;

/// What `descr` may say, for messages.
const ALLOWED_TYPES: &str = "allowed: f2, f4, f8, i1, i2, i4, i8, u1, u2, u4, u8 or b1 after <, >, | or =";

/// What the dictionary says.
#[derive(Debug)]
pub(super) struct Header {
    /// The type of an element: one of an array of numbers, or a record of fields.
    pub elements: Elements,
    /// Whether columns come one after the other, rather than rows.
    pub fortran_order: bool,
    /// Length of each dimension.
    pub shape: Vec<u64>,
}

/// What the elements of the array are.
#[derive(Debug)]
pub(super) enum Elements {
    Plain(Type),
    Records(Vec<Field>),
}

/// A field of a record.
#[derive(Debug)]
pub(super) struct Field {
    /// Empty for padding.
    pub name: String,
    pub kind: Type,
    /// Items of a sub-array, of all its dimensions together; absent: the field is no sub-array.
    pub items: Option<u64>,
    /// Bytes of the whole field.
    pub size: u64,
}

/// The type of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Type {
    /// A number, most significant byte first if the second says so.
    Number(Scalar, bool),
    /// Something else of so many bytes: how the header writes it, and what that means.
    Other { size: u64, text: String, meaning: &'static str },
}

impl Type {
    /// Bytes in the file.
    pub fn size(&self) -> u64 {
        match self {
            Self::Number(scalar, _) => scalar.size() as u64,
            Self::Other { size, .. } => *size,
        }
    }
}

/// What to say about a type that is none of numbers.
pub(super) fn unsupported(text: &str, meaning: &str) -> String {
    format!("the type {} ({meaning}) is not supported; {ALLOWED_TYPES}", quote(text.as_bytes()))
}

impl Header {
    /// Parses the text, which begins at byte `start` of the file.
    pub fn parse(text: &str, start: u64) -> Result<Self, ReadError> {
        let mut parser = Parser { text, at: 0, start };
        let document = parser.value(0)?;
        parser.space();
        if parser.at < text.len() {
            return Err(parser.wrong(parser.at, "nothing but spaces and a line end after the dictionary"));
        }
        let Value::Dictionary(entries) = document.value else {
            return Err(parser.wrong(document.at, "a dictionary such as {'descr': '<f4', ...}"));
        };
        let (mut descr, mut order, mut shape) = (None, None, None);
        for (key, value) in entries {
            let name = if let Value::Text(name) = &key.value { name.as_str() } else { "" };
            let slot = match name {
                "descr" => &mut descr,
                "fortran_order" => &mut order,
                "shape" => &mut shape,
                _ => return Err(parser.wrong(key.at, "the keys 'descr', 'fortran_order' and 'shape'")),
            };
            if slot.is_some() {
                return Err(parser.wrong(key.at, "each key once"));
            }
            *slot = Some(value);
        }
        let missing = |key: &str| ReadError::content(format!("byte {start}: the header has no '{key}'"));
        let order = order.ok_or_else(|| missing("fortran_order"))?;
        let Value::Truth(fortran_order) = order.value else {
            return Err(parser.wrong(order.at, "True or False"));
        };
        let shape = parser.shape(&shape.ok_or_else(|| missing("shape"))?)?;
        let elements = parser.elements(&descr.ok_or_else(|| missing("descr"))?)?;
        Ok(Self { elements, fortran_order, shape })
    }
}

/// A value and where it stands in the text.
struct Node {
    at: usize,
    value: Value,
}

enum Value {
    Text(String),
    Integer(u64),
    Truth(bool),
    Tuple(Vec<Node>),
    List(Vec<Node>),
    Dictionary(Vec<(Node, Node)>),
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    /// Of the text in the file.
    start: u64,
}

impl Parser<'_> {
    fn wrong(&self, at: usize, allowed: &str) -> ReadError {
        let byte = self.start + at as u64;
        let rest = self.text.as_bytes().get(at..).unwrap_or_default().trim_ascii_end();
        let found = if rest.is_empty() { "the header ends".to_owned() } else { quote(rest) };
        ReadError::content(format!("byte {byte}: {found}; allowed: {allowed}"))
    }

    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn space(&mut self) {
        while self.peek().is_some_and(|byte| byte.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    fn value(&mut self, depth: usize) -> Result<Node, ReadError> {
        self.space();
        let at = self.at;
        if depth > MAX_DEPTH {
            return Err(self.wrong(at, &format!("at most {MAX_DEPTH} levels of nesting")));
        }
        let value = match self.peek() {
            Some(b'\'' | b'"') => Value::Text(self.string()?),
            Some(b'0'..=b'9') => Value::Integer(self.integer()?),
            Some(b'(') => {
                let (mut items, comma) = self.items(b')', |parser| parser.value(depth + 1))?;
                // Without a comma these are mere parentheses.
                match items.pop() {
                    Some(item) if items.is_empty() && !comma => return Ok(item),
                    last => items.extend(last),
                }
                Value::Tuple(items)
            }
            Some(b'[') => Value::List(self.items(b']', |parser| parser.value(depth + 1))?.0),
            Some(b'{') => {
                let entry = |parser: &mut Self| {
                    let key = parser.value(depth + 1)?;
                    parser.space();
                    if parser.peek() != Some(b':') {
                        return Err(parser.wrong(parser.at, "a `:` after a key"));
                    }
                    parser.at += 1;
                    Ok((key, parser.value(depth + 1)?))
                };
                Value::Dictionary(self.items(b'}', entry)?.0)
            }
            _ if self.word("True") => Value::Truth(true),
            _ if self.word("False") => Value::Truth(false),
            _ => return Err(self.wrong(at, "a string, an integer, a tuple, a list, a dictionary, True or False")),
        };
        Ok(Node { at, value })
    }

    /// Passes over a word that ends there.
    fn word(&mut self, word: &str) -> bool {
        let rest = self.text.as_bytes().get(self.at..).unwrap_or_default();
        let ends = |rest: &[u8]| !rest.first().is_some_and(|&byte| byte.is_ascii_alphanumeric() || byte == b'_');
        let found = rest.strip_prefix(word.as_bytes()).is_some_and(ends);
        if found {
            self.at += word.len();
        }
        found
    }

    /// What stands between brackets, and whether a comma follows the last item.
    fn items<T>(
        &mut self,
        close: u8,
        mut item: impl FnMut(&mut Self) -> Result<T, ReadError>,
    ) -> Result<(Vec<T>, bool), ReadError> {
        self.at += 1;
        let mut items = Vec::new();
        let mut comma = false;
        loop {
            self.space();
            if self.peek() == Some(close) {
                self.at += 1;
                return Ok((items, comma));
            }
            if !items.is_empty() && !comma {
                return Err(self.wrong(self.at, &format!("`,` or `{}`", char::from(close))));
            }
            items.push(item(self)?);
            self.space();
            comma = self.peek() == Some(b',');
            if comma {
                self.at += 1;
            }
        }
    }

    fn integer(&mut self) -> Result<u64, ReadError> {
        let at = self.at;
        while self.peek().is_some_and(|byte| byte.is_ascii_digit()) {
            self.at += 1;
        }
        let number = self.text.get(at..self.at).and_then(|digits| digits.parse().ok());
        // Python 2 wrote long integers so.
        if self.peek() == Some(b'L') {
            self.at += 1;
        }
        number.ok_or_else(|| self.wrong(at, "an integer below 2^64"))
    }

    /// A string as Python's `repr` writes it.
    fn string(&mut self) -> Result<String, ReadError> {
        let start = self.at;
        let mut chars = self.text[start..].char_indices();
        let quote = chars.next().map(|(_, quote)| quote);
        let mut out = String::new();
        while let Some((offset, c)) = chars.next() {
            if Some(c) == quote {
                self.at = start + offset + c.len_utf8();
                return Ok(out);
            }
            if c != '\\' {
                out.push(c);
                continue;
            }
            let escaped = chars.next().map(|(_, c)| c);
            let mut code = |digits: usize| {
                let mut value = 0;
                for _ in 0..digits {
                    value = value * 16 + chars.next()?.1.to_digit(16)?;
                }
                char::from_u32(value)
            };
            let c = match escaped {
                Some(c @ ('\\' | '\'' | '"')) => Some(c),
                Some('n') => Some('\n'),
                Some('r') => Some('\r'),
                Some('t') => Some('\t'),
                Some('x') => code(2),
                Some('u') => code(4),
                Some('U') => code(8),
                _ => None,
            };
            out.push(c.ok_or_else(|| self.wrong(start + offset, "an escape as Python's repr writes it"))?);
        }
        Err(self.wrong(start, "a string that ends"))
    }

    // ---- what the values mean ----

    fn shape(&self, node: &Node) -> Result<Vec<u64>, ReadError> {
        let Value::Tuple(items) = &node.value else {
            return Err(self.wrong(node.at, "a shape such as (1000, 3)"));
        };
        items
            .iter()
            .map(|item| match item.value {
                Value::Integer(length) => Ok(length),
                _ => Err(self.wrong(item.at, "an integer from 0")),
            })
            .collect()
    }

    fn elements(&self, node: &Node) -> Result<Elements, ReadError> {
        match &node.value {
            Value::Text(text) => self.kind(text, node.at).map(Elements::Plain),
            Value::List(fields) => self.fields(fields).map(Elements::Records),
            _ => Err(self.wrong(node.at, "a type such as '<f4', or a list of fields such as [('x', '<f4'), ...]")),
        }
    }

    fn fields(&self, nodes: &[Node]) -> Result<Vec<Field>, ReadError> {
        nodes.iter().map(|node| self.field(node)).collect()
    }

    fn field(&self, node: &Node) -> Result<Field, ReadError> {
        let wrong = |at| self.wrong(at, "a field such as ('x', '<f4') or ('position', '<f4', (3,))");
        let Value::Tuple(parts) = &node.value else {
            return Err(wrong(node.at));
        };
        let (name, kind, shape) = match &parts[..] {
            [name, kind] => (name, kind, None),
            [name, kind, shape] => (name, kind, Some(shape)),
            _ => return Err(wrong(node.at)),
        };
        let name = match &name.value {
            Value::Text(name) => name,
            // A title and the name.
            Value::Tuple(pair) => match &pair[..] {
                [_, Node { value: Value::Text(name), .. }] => name,
                _ => return Err(wrong(name.at)),
            },
            _ => return Err(wrong(name.at)),
        };
        let kind = match &kind.value {
            Value::Text(text) => self.kind(text, kind.at)?,
            Value::List(fields) => {
                let fields = self.fields(fields)?;
                let size = fields.iter().try_fold(0_u64, |size, field| size.checked_add(field.size));
                let size = size.ok_or_else(|| self.wrong(kind.at, "a record of less than 2^64 bytes"))?;
                Type::Other { size, text: "[...]".to_owned(), meaning: "a record within the record" }
            }
            _ => return Err(wrong(kind.at)),
        };
        if name.is_empty() && !matches!(kind, Type::Other { .. }) {
            return Err(self.wrong(node.at, "a field with a name; padding without one is of a type such as '|V4'"));
        }
        if name.len() > LONGEST_NAME {
            return Err(self.wrong(node.at, &format!("a name of at most {LONGEST_NAME} bytes")));
        }
        let items = match shape {
            None => None,
            Some(Node { value: Value::Integer(length), .. }) => Some(*length),
            Some(shape) => {
                let product = self.shape(shape)?.iter().try_fold(1_u64, |product, &length| product.checked_mul(length));
                Some(product.ok_or_else(|| self.wrong(shape.at, "a sub-array of less than 2^64 items"))?)
            }
        };
        let size = items.unwrap_or(1).checked_mul(kind.size());
        let size = size.ok_or_else(|| self.wrong(node.at, "a field of less than 2^64 bytes"))?;
        Ok(Field { name: name.clone(), kind, items, size })
    }

    /// The type that a string such as `<f4` means.
    fn kind(&self, text: &str, at: usize) -> Result<Type, ReadError> {
        let wrong = || self.wrong(at, ALLOWED_TYPES.trim_start_matches("allowed: "));
        let (order, rest) = match text.as_bytes() {
            [order @ (b'<' | b'>' | b'|' | b'='), ..] => (*order, &text[1..]),
            _ => (b'=', text),
        };
        // As in NumPy, no order means that of the machine that reads.
        let big = order == b'>' || (order != b'<' && cfg!(target_endian = "big"));
        let mut letters = rest.chars();
        let letter = letters.next().ok_or_else(wrong)?;
        let rest = letters.as_str();
        // Of dates the unit follows.
        let digits = if matches!(letter, 'M' | 'm') { rest.split('[').next().unwrap_or_default() } else { rest };
        let size = match digits {
            "" if letter == 'O' => 0,
            digits => digits.parse::<u64>().map_err(|_| wrong())?,
        };
        let scalar = match (letter, size) {
            ('f', 2) => Some(Scalar::F16),
            ('f', 4) => Some(Scalar::F32),
            ('f', 8) => Some(Scalar::F64),
            ('i', 1) => Some(Scalar::I8),
            ('i', 2) => Some(Scalar::I16),
            ('i', 4) => Some(Scalar::I32),
            ('i', 8) => Some(Scalar::I64),
            ('u', 1) => Some(Scalar::U8),
            ('u', 2) => Some(Scalar::U16),
            ('u', 4) => Some(Scalar::U32),
            ('u', 8) => Some(Scalar::U64),
            ('b', 1) => Some(Scalar::Bool),
            _ => None,
        };
        if let Some(scalar) = scalar {
            return Ok(Type::Number(scalar, big));
        }
        let meaning = match letter {
            'f' if matches!(size, 12 | 16) => "a float of extended precision",
            'c' => "complex numbers",
            'S' | 'a' => "strings of bytes",
            'U' => "strings",
            'V' => "raw bytes",
            'M' | 'm' => "dates and times",
            'O' => {
                return Err(ReadError::content(format!(
                    "byte {}: the type {} (Python objects) is not supported, because reading it could run any code; \
                     save plain numbers: numpy.save(name, array.astype(numpy.float32))",
                    self.start + at as u64,
                    quote(text.as_bytes())
                )));
            }
            _ => return Err(wrong()),
        };
        // A character of `U` takes four bytes.
        let size = if letter == 'U' { size.checked_mul(4).ok_or_else(wrong)? } else { size };
        // Of a long text no more than an error shows: a sub-array repeats it too.
        Ok(Type::Other { size, text: text.chars().take(41).collect(), meaning })
    }
}
