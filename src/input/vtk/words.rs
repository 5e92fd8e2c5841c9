//! Words between white space, read from a stream without holding more than one of them.

use crate::input::columns::{ReadError, quote};
use crate::input::source::Source;

/// Longest word that is accepted, bytes: VTK itself reads at most 255.
const LONGEST_WORD: usize = 1 << 12;

/// Hands over up to `count` words with their numbers from 0, and returns how many there were before the byte `stop` or
/// the end of the stream. The white space behind the last word, and `stop`, are left in the stream.
///
/// What `each` returns as an error is put behind the line.
pub fn for_each_word(
    source: &mut Source,
    count: u64,
    stop: Option<u8>,
    mut each: impl FnMut(u64, &[u8]) -> Result<(), String>,
) -> Result<u64, ReadError> {
    let mut done = 0;
    // The beginning of a word that goes on in the next buffer.
    let mut held: Vec<u8> = Vec::new();
    let mut stopped = false;
    while done < count && !stopped {
        let buffer = source.available()?;
        let (mut at, mut lines) = (0, 0);
        let mut result = Ok(());
        if buffer.is_empty() {
            if !held.is_empty() {
                each(done, &held).map_err(|problem| at_line(source, &problem))?;
                done += 1;
            }
            break;
        }
        while done < count {
            if held.is_empty() {
                let blank = |byte: &u8| byte.is_ascii_whitespace();
                let rest = buffer.get(at..).unwrap_or_default();
                let skipped = rest.iter().position(|byte| !blank(byte)).unwrap_or(rest.len());
                lines += rest.iter().take(skipped).filter(|&&byte| byte == b'\n').count() as u64;
                at += skipped;
                stopped = stop.is_some() && buffer.get(at).copied() == stop;
            }
            let rest = buffer.get(at..).unwrap_or_default();
            if rest.is_empty() || stopped {
                break;
            }
            let end = rest.iter().position(|&byte| byte.is_ascii_whitespace() || Some(byte) == stop);
            let part = rest.get(..end.unwrap_or(rest.len())).unwrap_or_default();
            at += part.len();
            if held.len() + part.len() > LONGEST_WORD {
                let word = quote(if held.is_empty() { part } else { &held });
                result = Err(format!("{word} is longer than {LONGEST_WORD} bytes"));
                break;
            }
            if end.is_none() {
                held.extend_from_slice(part);
                break;
            }
            result = if held.is_empty() {
                each(done, part)
            } else {
                held.extend_from_slice(part);
                each(done, &held)
            };
            held.clear();
            if result.is_err() {
                break;
            }
            done += 1;
        }
        source.consume(at);
        source.line += lines;
        result.map_err(|problem| at_line(source, &problem))?;
    }
    Ok(done)
}

/// The next word; none at the end of the stream.
pub fn next_word(source: &mut Source) -> Result<Option<Vec<u8>>, ReadError> {
    let mut found = None;
    for_each_word(source, 1, None, |_, word| {
        found = Some(word.to_vec());
        Ok(())
    })?;
    Ok(found)
}

fn at_line(source: &Source, problem: &str) -> ReadError {
    ReadError::content(format!("line {}: {problem}", source.line + 1))
}
