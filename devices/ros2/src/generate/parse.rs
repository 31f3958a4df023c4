//! The files: lines of fields, constants and comments.

use super::types::{Type, is_package_name, is_type_name};
use super::{GenerateError, stem};
use std::path::{Path, PathBuf};

/// A file.
#[derive(Debug)]
pub(super) struct Interface {
    pub(super) path: PathBuf,
    pub(super) package: String,
    pub(super) name: String,
    pub(super) parts: Parts,
}

/// A message has one part, a service two.
#[derive(Debug)]
pub(super) enum Parts {
    Message(Part),
    Service(Part, Part),
}

/// The fields and constants of a message, a request or a reply.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub(super) doc: Vec<String>,
    pub(super) fields: Vec<Member>,
    pub(super) constants: Vec<Member>,
}

/// A field with its default, if it has one, or a constant with its value.
#[derive(Debug)]
pub(super) struct Member {
    pub(super) name: String,
    pub(super) kind: Type,
    pub(super) value: Option<String>,
    pub(super) doc: Vec<String>,
    pub(super) line: usize,
}

impl Interface {
    pub(super) fn parse(
        path: &Path,
        package: &str,
        kind: &str,
        text: &str,
    ) -> Result<Self, GenerateError> {
        let name = stem(path);
        let refused = |line, what| GenerateError::Refused {
            path: path.to_owned(),
            line,
            what,
        };
        if !is_package_name(package) || !is_type_name(&name) {
            return Err(refused(
                1,
                format!(
                    "`{package}/{name}` is no name of ROS 2: a package is in lower case, an interface begins with a capital"
                ),
            ));
        }
        let mut parts = vec![Part::default()];
        let mut comments = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let number = index + 1;
            let refused = |what| refused(number, what);
            let Some(part) = parts.last_mut() else { break };
            if line.trim_end() == "---" {
                comments.clear();
                parts.push(Part::default());
                continue;
            }
            let (code, comment) = split_comment(line);
            let code = code.trim();
            if code.is_empty() {
                match comment {
                    Some(comment) => comments.push(comment),
                    // The first block of comments is the message's own.
                    None if part.doc.is_empty() && part.fields.is_empty() => {
                        part.doc = std::mem::take(&mut comments);
                    }
                    None => comments.clear(),
                }
                continue;
            }
            let mut doc = std::mem::take(&mut comments);
            doc.extend(comment);
            member(part, code, package, doc, number).map_err(refused)?;
        }
        let count = parts.len();
        let mut parts = parts.into_iter();
        let parts = match (kind, parts.next(), parts.next(), count) {
            ("msg", Some(only), None, _) => Parts::Message(only),
            ("srv", Some(request), Some(reply), 2) => Parts::Service(request, reply),
            ("msg", ..) => {
                return Err(refused(1, "a message has no line `---`".to_owned()));
            }
            _ => {
                let what = "a service has one line `---`, between request and reply";
                return Err(refused(1, what.to_owned()));
            }
        };
        Ok(Self {
            path: path.to_owned(),
            package: package.to_owned(),
            name,
            parts,
        })
    }

    pub(super) fn refused(&self, line: usize, what: String) -> GenerateError {
        GenerateError::Refused {
            path: self.path.clone(),
            line,
            what,
        }
    }
}

fn member(
    part: &mut Part,
    code: &str,
    package: &str,
    doc: Vec<String>,
    line: usize,
) -> Result<(), String> {
    let (kind, rest) = code
        .split_once(char::is_whitespace)
        .ok_or_else(|| format!("`{code}` has no name; write TYPE NAME"))?;
    let kind = Type::parse(kind, package)?;
    let rest = rest.trim();
    let end = rest.find(|letter: char| letter.is_whitespace() || letter == '=');
    let (name, rest) = rest.split_at(end.unwrap_or(rest.len()));
    let rest = rest.trim();
    let is_taken = |members: &[Member]| members.iter().any(|member| member.name == name);
    if is_taken(&part.fields) || is_taken(&part.constants) {
        return Err(format!("`{name}` is there twice"));
    }
    let (value, is_constant) = match rest.strip_prefix('=') {
        Some(value) => (Some(value.trim().to_owned()), true),
        None => ((!rest.is_empty()).then(|| rest.to_owned()), false),
    };
    let member = Member {
        name: name.to_owned(),
        kind,
        value,
        doc,
        line,
    };
    if is_constant {
        let is_name = name.starts_with(|first: char| first.is_ascii_uppercase())
            && name.chars().all(|letter| {
                letter.is_ascii_uppercase() || letter.is_ascii_digit() || letter == '_'
            });
        if !is_name {
            return Err(format!("`{name}`: a constant's name is in capitals"));
        }
        if !member.kind.is_constant() {
            return Err(format!(
                "`{name}`: a constant is a number, a bool or a string"
            ));
        }
        part.constants.push(member);
    } else {
        if !is_package_name(name) || name.contains("__") || name.ends_with('_') {
            return Err(format!(
                "`{name}` is no field's name: lower case, digits and single underscores inside"
            ));
        }
        part.fields.push(member);
    }
    Ok(())
}

/// Code and comment of a line. A `#` in quotes begins none.
fn split_comment(line: &str) -> (&str, Option<String>) {
    let mut quote = None;
    for (index, letter) in line.char_indices() {
        match (letter, quote) {
            ('#', None) => {
                let comment = line[index..].trim_start_matches('#').trim();
                return (&line[..index], Some(comment.to_owned()));
            }
            ('"' | '\'', None) => quote = Some(letter),
            (_, Some(open)) if open == letter => quote = None,
            _ => {}
        }
    }
    (line, None)
}
