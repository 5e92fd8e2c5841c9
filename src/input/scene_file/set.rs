//! `--set path.to.key=value`: changes to the document before it is read.

use super::text::{Place, Problems};
use super::tree::{Entry, Node, Table, Value, parse_value};

/// Keys of the top level that hold a list of tables; a setting never creates one of their entries in passing.
const LISTS: &[&str] = &["particles", "mesh"];

/// Longest path of a setting.
const MAX_PATH: usize = 16;

const FORM: &str = "allowed: path.to.key=value, as in camera.fov_y_deg=30 or particles.0.radius=0.3";

/// One parsed setting.
pub(super) struct Setting {
    path: Vec<Segment>,
    node: Node,
}

/// One step of a path: a key, or the index of an entry.
#[derive(Clone)]
struct Segment {
    name: String,
    place: Place,
}

/// Parses one setting whose first byte has address `base`; what is wrong with its form is reported.
pub(super) fn parse(text: &str, base: usize, problems: &Problems<'_>) -> Option<Setting> {
    let whole = Place { start: base, end: base + text.len() };
    let Some((key, value)) = text.split_once('=') else {
        problems.report(whole, format!("`{}` has no `=`", problems.texts.snippet(whole)), FORM);
        return None;
    };
    let path = parse_path(key, base, problems);
    let start = base + key.len() + 1 + (value.len() - value.trim_start().len());
    let value = value.trim();
    if value.is_empty() {
        let message = format!("`{}` has no value", problems.texts.snippet(whole));
        problems.report(Place { start: whole.end, end: whole.end }, message, "an empty string is written \"\"");
        return None;
    }
    let node = parse_value(value, start, problems);
    Some(Setting { path: path?, node: node? })
}

/// The steps of `a.b.0.c` or `a.b[0].c`.
fn parse_path(key: &str, base: usize, problems: &Problems<'_>) -> Option<Vec<Segment>> {
    let mut path = Vec::new();
    let mut start = base;
    for part in key.split('.') {
        let place = trimmed(part, start);
        let (name, indices) = part.find('[').map_or((part, ""), |at| part.split_at(at));
        let name_place = trimmed(name, start);
        let name = name.trim();
        let name = name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name);
        if name.is_empty() {
            problems.report(place, format!("empty key in `{}`", key.trim()), FORM);
            return None;
        }
        path.push(Segment { name: name.to_owned(), place: name_place });
        let mut rest = indices.trim_end();
        while !rest.is_empty() {
            let index = rest.strip_prefix('[').and_then(|rest| rest.split_once(']'));
            let Some((index, after)) = index.filter(|(index, _)| index.trim().parse::<usize>().is_ok()) else {
                problems.report(place, format!("`{}` is no index", indices.trim_end()), FORM);
                return None;
            };
            let offset = part.trim_end().len() - rest.len() + 1;
            path.push(Segment { name: index.trim().to_owned(), place: trimmed(index, start + offset) });
            rest = after;
        }
        start += part.len() + 1;
    }
    if path.len() > MAX_PATH {
        let place = Place { start: base, end: base + key.len() };
        problems.report(place, format!("the path has {} keys", path.len()), format!("allowed: at most {MAX_PATH}"));
        return None;
    }
    Some(path)
}

/// The place of `part`, which starts at address `start`, without the white space around it.
fn trimmed(part: &str, start: usize) -> Place {
    let start = start + part.len() - part.trim_start().len();
    Place { start, end: start + part.trim().len() }
}

/// Applies a setting to the document; tables that are missing are created.
pub(super) fn apply(setting: Setting, document: &mut Node, problems: &Problems<'_>) {
    let Setting { path, node } = setting;
    let mut target = document;
    for (i, step) in path.iter().enumerate() {
        // A value of another kind that stands in the way gives place to a table: `kernel.table=...` where the file
        // has a kernel's name. What cannot be a table is refused later, when the document is read.
        if !matches!(target.value, Value::Array(_) | Value::Table(_)) {
            *target = Node { place: path[i - 1].place, value: Value::Table(Table::default()) };
        }
        let is_last = i + 1 == path.len();
        let Some(next) = descend(target, step, &path[..i], is_last, problems) else {
            return;
        };
        target = next;
    }
    *target = node;
}

/// The value one step down, created where a table lacks the key; what cannot be is reported. The last step's value is
/// about to be replaced, so its key moves to the setting as well.
fn descend<'a>(
    target: &'a mut Node,
    step: &Segment,
    above: &[Segment],
    is_last: bool,
    problems: &Problems<'_>,
) -> Option<&'a mut Node> {
    let Segment { name, place } = step;
    match &mut target.value {
        Value::Table(table) => match table.entries.iter().position(|entry| entry.key == *name) {
            Some(at) => {
                let entry = &mut table.entries[at];
                if is_last {
                    entry.key_place = *place;
                }
                Some(&mut entry.node)
            }
            None if above.is_empty() && !is_last && LISTS.contains(&name.as_str()) => {
                problems.report(
                    *place,
                    format!("the scene has no [[{name}]]"),
                    format!("add [[{name}]] to the file, or set the whole list: {name} = [{{ file = \"...\" }}]"),
                );
                None
            }
            None => {
                let node = Node { place: *place, value: Value::Table(Table::default()) };
                table.entries.push(Entry { key: name.clone(), key_place: *place, node });
                table.entries.last_mut().map(|entry| &mut entry.node)
            }
        },
        Value::Array(items) => {
            let path = above.iter().map(|segment| segment.name.as_str()).collect::<Vec<_>>().join(".");
            let count = items.len();
            let indices = match count {
                0 => "nothing: it is empty".to_owned(),
                1 => format!("{path}.0"),
                _ => format!("{path}.0 to {path}.{}", count - 1),
            };
            match name.parse::<usize>() {
                Ok(index) if index < count => items.get_mut(index),
                Ok(_) => {
                    let message = format!("`{path}` has no entry {name}: it has {count}, counted from 0");
                    problems.report(*place, message, format!("allowed: {indices}"));
                    None
                }
                Err(_) => match &mut items[..] {
                    // The only entry is meant.
                    [only] if matches!(only.value, Value::Table(_)) => descend(only, step, above, is_last, problems),
                    _ => {
                        let message = format!("`{path}` has {count} entries: say which one's `{name}`");
                        problems.report(*place, message, format!("allowed: {indices}"));
                        None
                    }
                },
            }
        }
        Value::String(_) | Value::Integer(_) | Value::Float(_) | Value::Boolean(_) | Value::Datetime => None,
    }
}
