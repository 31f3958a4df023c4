//! What channels hold, in Rust.

use super::names::{Names, camel};
use super::writer::Writer;
use crate::file::{self, Composition, Content};
use crate::model::Model;
use crate::network::Channel;
use crate::text::Problem;

/// Types of Rust that a model may name as they are.
const OF_RUST: [&str; 16] = [
    "i8", "i16", "i32", "i64", "i128", "isize", "u8", "u16", "u32", "u64", "u128", "usize", "f32",
    "f64", "char", "String",
];

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Type {
    Unit,
    Bool,
    /// A range: as in the model, numbers are 32 bits.
    Int,
    /// A type of Rust that the check does not follow.
    OfRust(&'static str),
    /// One that a person defines.
    Defined(String),
}

impl Type {
    pub(super) fn rust(&self) -> &str {
        match self {
            Self::Unit => "()",
            Self::Bool => "bool",
            Self::Int => "i32",
            Self::OfRust(name) => name,
            Self::Defined(name) => name,
        }
    }

    /// Where the modules of `generated` find it.
    pub(super) fn path(&self) -> String {
        match self {
            Self::Defined(name) => format!("types::{name}"),
            _ => self.rust().to_owned(),
        }
    }

    /// A value of it, if the model states none.
    pub(super) fn any(&self) -> &'static str {
        match self {
            Self::Unit => "()",
            Self::Bool => "false",
            Self::Int => "0",
            Self::OfRust(_) | Self::Defined(_) => "Default::default()",
        }
    }
}

/// What a channel holds.
pub(super) fn type_of(model: &Model, channel: &Channel) -> Result<Type, Problem> {
    let name = channel.type_name.as_str();
    if channel.values.is_some() {
        return Ok(if name == "bool" {
            Type::Bool
        } else {
            Type::Int
        });
    }
    if name == "()" {
        return Ok(Type::Unit);
    }
    if let Some(known) = OF_RUST.into_iter().find(|known| *known == name) {
        return Ok(Type::OfRust(known));
    }
    let rust = camel(name);
    let Some(stated) = stated(model, name) else {
        return Ok(Type::Defined(rust));
    };
    if name.contains(|c: char| !(c.is_alphanumeric() || c == '_')) {
        let message = format!("the type `{name}` of this channel is no name");
        let advice = "write a name, such as `Image`; what it is in Rust is defined in types.rs";
        let span = stated.name.1.clone();
        return Err(model.source().problem(span, message, advice));
    }
    let mut names = Names::new(model.source(), &[]);
    let named = (name.to_owned(), stated.name.1.clone());
    names.take(rust.clone(), &named, "the type")?;
    Ok(Type::Defined(rust))
}

/// Refuses two types of the model that become one type in Rust.
pub(super) fn check(model: &Model) -> Result<(), Problem> {
    let mut known: Vec<(String, &str)> = Vec::new();
    for channel in &model.network.channels {
        let Type::Defined(rust) = type_of(model, channel)? else {
            continue;
        };
        let name = channel.type_name.as_str();
        let before = known.iter().find(|(one, _)| *one == rust);
        match before.map(|(_, before)| *before) {
            None => known.push((rust, name)),
            Some(before) if before == name => {}
            Some(before) => {
                let message =
                    format!("the types `{before}` and `{name}` are both `{rust}` in Rust");
                let advice = "write one name for one type";
                let found = stated(model, name).or_else(|| stated(model, before));
                let span = found.map_or(0..0, |channel| channel.name.1.clone());
                return Err(model.source().problem(span, message, advice));
            }
        }
    }
    Ok(())
}

/// The first channel of the file that has this type.
fn stated<'m>(model: &'m Model, type_name: &str) -> Option<&'m file::Channel> {
    let definitions = model.document.definitions.iter();
    let composed = definitions.filter_map(|definition| match &definition.content {
        Content::Composition(composition) => Some(composition),
        Content::Body(_) => None,
    });
    let system = model.document.system.iter().map(|(_, system)| system);
    let all: Vec<&Composition> = composed.chain(system).collect();
    let mut channels = all
        .into_iter()
        .flat_map(|composition| &composition.channels);
    channels.find(|channel| channel.type_name == type_name)
}

/// The file of the types that a person defines.
pub(super) fn skeleton(types: &[String]) -> String {
    let mut out = Writer::default();
    out.line(
        "//! The types of the model. `luna model generate` wrote this once: change it as you like.",
    );
    for name in types {
        out.line("");
        out.line("#[derive(Clone, Default, Debug)]");
        out.line(format!("pub struct {name};"));
    }
    out.finish()
}
