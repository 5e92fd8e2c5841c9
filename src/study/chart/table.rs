//! The chart as a table, and as CSV.

use std::fmt::Write;

use super::front::front;

/// A candidate and what was measured of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What the measures depend on, as 16 hexadecimal digits.
    pub key: String,
    /// As [`super::Candidate::method`].
    pub method: String,
    /// As [`super::Candidate::parameter`].
    pub parameter: String,
    /// As [`super::Candidate::value`].
    pub value: String,
    /// The tolerance of early termination.
    pub tolerance: f64,
    /// The method that drew it: what `auto` chose.
    pub drawn: String,
    /// Frames that were measured.
    pub frames: u32,
    /// Median time of a stereo frame, milliseconds.
    pub median_ms: f64,
    /// The fastest frame, milliseconds.
    pub min_ms: f64,
    /// How far the middle half of the frames lies apart, milliseconds.
    pub spread_ms: f64,
    /// Fragments computed in a frame.
    pub fragments: u64,
    /// As [`super::Errors::rmse`], and so on.
    pub rmse: f64,
    /// Standard error of `rmse` from sampling.
    pub rmse_se: f64,
    /// Largest error.
    pub max: f64,
    /// 99 % quantile.
    pub q99: f64,
    /// Largest error of the transmittance.
    pub transmittance_max: f64,
    /// Left-right inconsistency, root mean square; absent where there is none.
    pub inconsistency_rmse: Option<f64>,
    /// Left-right inconsistency, largest.
    pub inconsistency_max: Option<f64>,
    /// Median time of each stage, milliseconds, in the order in which they run.
    pub stages: Vec<(String, f64)>,
}

/// The first line of the CSV. `front` is `yes` for points on the Pareto front, else `no`; `stages` holds `name=milliseconds`,
/// parted by blanks.
pub const HEADER: &str = "key,method,parameter,value,tolerance,drawn,frames,median_ms,min_ms,spread_ms,fragments,rmse,rmse_se,max,q99,\
                          transmittance_max,inconsistency_rmse,inconsistency_max,front,stages";

/// Which rows are on the Pareto front of median time and RMSE.
pub fn on_front(rows: &[Row]) -> Vec<bool> {
    front(&rows.iter().map(|row| [row.median_ms, row.rmse]).collect::<Vec<_>>())
}

/// The whole table; numbers with the shortest digits that read back exactly.
pub fn to_csv(rows: &[Row]) -> String {
    let mut text = format!("{HEADER}\n");
    for (row, front) in rows.iter().zip(on_front(rows)) {
        let stages: Vec<String> = row.stages.iter().map(|(name, ms)| format!("{name}={ms}")).collect();
        let optional = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        // No name of the table has a comma or a quotation mark.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            row.key,
            row.method,
            row.parameter,
            row.value,
            row.tolerance,
            row.drawn,
            row.frames,
            row.median_ms,
            row.min_ms,
            row.spread_ms,
            row.fragments,
            row.rmse,
            row.rmse_se,
            row.max,
            row.q99,
            row.transmittance_max,
            optional(row.inconsistency_rmse),
            optional(row.inconsistency_max),
            if front { "yes" } else { "no" },
            stages.join(" ")
        );
    }
    text
}

/// The rows of a table that [`to_csv`] wrote. Rows that cannot be read are left out, and so is the last one of a file that
/// ends within it. `None` if the text is no such table.
pub fn from_csv(text: &str) -> Option<Vec<Row>> {
    // A line without its end may hold a part of a number, which reads as another.
    let mut lines = text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n'));
    (lines.next()? == HEADER).then(|| lines.filter_map(row).collect())
}

fn row(line: &str) -> Option<Row> {
    let cells: Vec<&str> = line.split(',').collect();
    let [
        key,
        method,
        parameter,
        value,
        tolerance,
        drawn,
        frames,
        median_ms,
        min_ms,
        spread_ms,
        fragments,
        rmse,
        rmse_se,
        max,
        q99,
        transmittance_max,
        inconsistency_rmse,
        inconsistency_max,
        front,
        stages,
    ] = cells[..]
    else {
        return None;
    };
    let number = |cell: &str| cell.parse::<f64>().ok().filter(|value| *value >= 0.0);
    let optional = |cell: &str| if cell.is_empty() { Some(None) } else { number(cell).map(Some) };
    let stage = |text: &str| text.split_once('=').and_then(|(name, ms)| Some((name.to_owned(), number(ms)?)));
    matches!(front, "yes" | "no").then_some(())?;
    Some(Row {
        key: key.into(),
        method: method.into(),
        parameter: parameter.into(),
        value: value.into(),
        tolerance: number(tolerance)?,
        drawn: drawn.into(),
        frames: frames.parse().ok()?,
        median_ms: number(median_ms)?,
        min_ms: number(min_ms)?,
        spread_ms: number(spread_ms)?,
        fragments: fragments.parse().ok()?,
        rmse: number(rmse)?,
        rmse_se: number(rmse_se)?,
        max: number(max)?,
        q99: number(q99)?,
        transmittance_max: number(transmittance_max)?,
        inconsistency_rmse: optional(inconsistency_rmse)?,
        inconsistency_max: optional(inconsistency_max)?,
        stages: stages.split(' ').map(stage).collect::<Option<_>>()?,
    })
}
