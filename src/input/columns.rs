//! Named columns of numbers, what every particle file is read into.
//!
//! A file may hold a hundred properties per particle of which a picture needs four, so a reader is told with a
//! [`Selection`] what is wanted and stores nothing else. The arrays later move into a
//! [`ParticleSet`](crate::scene::ParticleSet) as they are.

/// The most rows a particle file may have: particles are numbered with 32 bits.
pub const MAX_ROWS: u64 = u32::MAX as u64;

/// Which columns of a file a reader keeps.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Every column, each of which then has to be numeric.
    All,
    /// The columns of these names, where the file has them; what it lacks is no error here.
    Named(Vec<String>),
    /// The columns of these names, to be looked at rather than used: whatever is no finite number, text included, is
    /// read as NaN.
    Survey(Vec<String>),
}

impl Selection {
    /// The columns of these names.
    pub fn named<S: Into<String>>(names: impl IntoIterator<Item = S>) -> Self {
        Self::Named(names.into_iter().map(Into::into).collect())
    }

    /// Whether the column of this name is kept.
    pub fn wants(&self, name: &str) -> bool {
        match self {
            Self::All => true,
            Self::Named(names) | Self::Survey(names) => names.iter().any(|wanted| wanted == name),
        }
    }

    /// Whether what is no finite number is read as NaN instead of being an error.
    pub fn is_lenient(&self) -> bool {
        matches!(self, Self::Survey(_))
    }
}

/// One column of a particle file.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The file's own name of the column.
    pub name: String,
    /// One finite number per row, as the file has it; NaN for what is none, in a [`Selection::Survey`] alone.
    pub values: Vec<f64>,
    /// Whether the file holds unsigned 8-bit integers here: as a colour they are sRGB-encoded, 0 to 255.
    pub byte: bool,
}

/// Where the rows are the cells of a volume: what a column of them means.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Name of the column that holds the mean of the volume's density over each cell.
    pub density: String,
    /// Volume of a cell, > 0, in cubes of the file's unit of length.
    pub volume: f64,
}

/// The columns read from one file. Invariant: every column has [`Columns::len`] values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Columns {
    columns: Vec<Column>,
    names: Vec<String>,
    len: usize,
    colors: &'static [[&'static str; 3]],
    /// Set where the rows are the cells of a volume.
    pub cells: Option<Cells>,
    /// What was left out or is surprising, a sentence each, without the file's name.
    pub notes: Vec<String>,
}

impl Columns {
    /// Columns as a reader found them.
    ///
    /// `columns` are those kept, `names` all numeric columns of the file (for messages), `len` the number of rows,
    /// `colors` the triples of names that mean colour in this format, best first. Fails if a column has another length.
    pub fn new(
        columns: Vec<Column>,
        names: Vec<String>,
        len: usize,
        colors: &'static [[&'static str; 3]],
    ) -> Result<Self, ReadError> {
        match columns.iter().find(|column| column.values.len() != len) {
            Some(c) => Err(ReadError::content(format!("column `{}` has {} values of {len}", c.name, c.values.len()))),
            None => Ok(Self { columns, names, len, colors, cells: None, notes: Vec::new() }),
        }
    }

    /// Number of rows, whether or not a column was kept.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The columns kept, in file order.
    pub fn iter(&self) -> impl Iterator<Item = &Column> {
        self.columns.iter()
    }

    /// Every column the file has, kept or not, in file order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether the file has a column of this name, kept or not.
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    /// The file's own colour: the first triple of names that means colour in this format and is there in full.
    pub fn color_names(&self) -> Option<[&'static str; 3]> {
        self.colors.iter().copied().find(|triple| triple.iter().all(|name| self.has(name)))
    }

    /// The column of this name, if it was kept.
    pub fn get(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    /// Takes the column of this name out, without a copy.
    pub fn take(&mut self, name: &str) -> Option<Column> {
        let index = self.columns.iter().position(|column| column.name == name)?;
        Some(self.columns.remove(index))
    }

    /// Frees every column whose name `keep` does not accept.
    pub fn retain(&mut self, mut keep: impl FnMut(&str) -> bool) {
        self.columns.retain(|column| keep(&column.name));
    }
}

/// Why a reader gave up. The caller adds the file's name.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system could not read.
    #[error("cannot read: {0}")]
    Io(#[from] std::io::Error),
    /// The content is not what the format allows; the message says where (line or byte offset) and what is allowed.
    #[error("{0}")]
    Content(String),
}

impl ReadError {
    /// A [`ReadError::Content`].
    pub fn content(message: impl Into<String>) -> Self {
        Self::Content(message.into())
    }
}

/// A piece of a file for an error message: at most 40 characters, invalid UTF-8 and control characters replaced.
pub(super) fn quote(text: &[u8]) -> String {
    const LONGEST: usize = 40;
    // Four bytes hold any character, so that a huge field is not converted as a whole.
    let head = &text[..text.len().min(4 * LONGEST)];
    let shown: String = String::from_utf8_lossy(head)
        .chars()
        .take(LONGEST)
        .map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c })
        .collect();
    let all = head.len() == text.len() && String::from_utf8_lossy(head).chars().count() <= LONGEST;
    if all { format!("`{shown}`") } else { format!("`{shown}...`") }
}

/// The finite number that a field of text spells, or what to say instead (without the place).
pub(super) fn number(field: &[u8]) -> Result<f64, String> {
    const ALLOWED: &str = "allowed: a finite number such as -1.5 or 2e-3";
    let text = field.trim_ascii();
    if text.is_empty() {
        return Err(format!("the field is empty; {ALLOWED}"));
    }
    match std::str::from_utf8(text).ok().and_then(|text| text.parse::<f64>().ok()) {
        Some(value) if value.is_finite() => Ok(value),
        Some(_) => Err(format!("{} is not finite; {ALLOWED}", quote(text))),
        None => Err(format!("{} is not a number; {ALLOWED}", quote(text))),
    }
}

/// As [`number`], but NaN for what is no finite number.
pub(super) fn number_or_nan(field: &[u8]) -> f64 {
    let value = std::str::from_utf8(field.trim_ascii()).ok().and_then(|text| text.parse::<f64>().ok());
    value.filter(|value| value.is_finite()).unwrap_or(f64::NAN)
}

/// Room for `count` more values, or an error instead of an abort where memory is short.
pub(super) fn reserve<T>(values: &mut Vec<T>, count: usize) -> Result<(), ReadError> {
    values
        .try_reserve_exact(count)
        .map_err(|_| ReadError::content(format!("not enough memory for {count} values of a column")))
}
