//! How values of a type lie in memory, as its name says it.

#[cfg(feature = "serde")]
use super::scalar::Part;
use super::scalar::Scalar;
use crate::error::TypeInfo;
use std::fmt::{self, Write};

/// What serde's encoding has before a value.
const LENGTH: usize = size_of::<usize>();

/// Of a type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Form {
    /// Without parts.
    Scalar(Scalar),
    /// So many of another form, one behind the other.
    Array(Box<Form>, usize),
    /// No value: `()`.
    Unit,
    /// A string of serde, of at most so many bytes.
    Text(usize),
    /// So many bytes.
    Raw(usize),
    /// At most so many bytes, in serde's encoding.
    RawSerde(usize),
}

impl Form {
    /// Of plain data, if the name says it, and size and alignment fit.
    pub(super) fn plain(info: &TypeInfo) -> Option<Self> {
        let form = Self::named(&info.name)?;
        let fits = form.size() as u64 == info.size && form.align() as u64 == info.align;
        fits.then_some(form)
    }

    /// Of a type of serde.
    pub(super) fn of_serde(info: &TypeInfo) -> Option<Self> {
        let is_text = info.name == "alloc::string::String by postcard";
        is_text.then_some(Form::Text(info.size as usize))
    }

    fn named(name: &str) -> Option<Self> {
        if name == "()" {
            return Some(Form::Unit);
        }
        if let Some(scalar) = Scalar::named(name) {
            return Some(Form::Scalar(scalar));
        }
        let (element, length) = name
            .strip_prefix('[')?
            .strip_suffix(']')?
            .rsplit_once("; ")?;
        let (element, length) = (Self::named(element)?, length.parse::<usize>().ok()?);
        // No larger than memory can be.
        element
            .size()
            .checked_mul(length)
            .map(|_| Form::Array(Box::new(element), length))
    }

    /// Of plain data, in bytes; else at most so many.
    fn size(&self) -> usize {
        match self {
            Form::Scalar(scalar) => scalar.size(),
            // Checked when the form was made.
            Form::Array(element, length) => element.size().saturating_mul(*length),
            Form::Unit => 0,
            Form::Text(size) | Form::Raw(size) | Form::RawSerde(size) => *size,
        }
    }

    fn align(&self) -> usize {
        match self {
            Form::Scalar(scalar) => scalar.align(),
            Form::Array(element, _) => element.align(),
            _ => 1,
        }
    }

    fn is_encoded(&self) -> bool {
        matches!(self, Form::Text(_) | Form::RawSerde(_))
    }

    /// The bytes of a value's place in shared memory.
    pub(super) fn room(&self) -> usize {
        match self.is_encoded() {
            true => LENGTH.saturating_add(self.size()),
            false => self.size(),
        }
    }

    /// A value's bytes as they lie in its place.
    pub(super) fn laid_out(&self, bytes: &[u8]) -> Vec<u8> {
        match self.is_encoded() {
            true => [&bytes.len().to_ne_bytes()[..], bytes].concat(),
            false => bytes.to_vec(),
        }
    }

    /// A value's bytes out of those of its place.
    pub(super) fn taken_up(&self, place: &[u8]) -> Option<Vec<u8>> {
        if !self.is_encoded() {
            return Some(place.to_vec());
        }
        let (length, rest) = place.split_first_chunk::<LENGTH>()?;
        rest.get(..usize::from_ne_bytes(*length))
            .map(<[u8]>::to_vec)
    }

    /// The bytes, if they are a value.
    pub(super) fn value(&self, bytes: &[u8]) -> Option<Vec<u8>> {
        let is_one = match self {
            Form::Text(_) => text(bytes).is_some(),
            Form::RawSerde(most) => bytes.len() <= *most,
            Form::Raw(size) => bytes.len() == *size,
            _ => bytes.len() == self.size() && self.is_valid(bytes),
        };
        is_one.then(|| bytes.to_vec())
    }

    fn is_valid(&self, bytes: &[u8]) -> bool {
        match self {
            Form::Scalar(scalar) => scalar.read(bytes).is_some(),
            Form::Array(element, _) => element.each(bytes).all(|part| element.is_valid(part)),
            _ => true,
        }
    }

    /// The elements of an array of this form.
    fn each<'b>(&self, bytes: &'b [u8]) -> impl Iterator<Item = &'b [u8]> {
        // Of empty elements there is nothing to see.
        bytes.chunks_exact(self.size().max(1))
    }

    /// The bytes of a value.
    pub(super) fn parse(&self, given: &str) -> Result<Vec<u8>, String> {
        let mut bytes = Vec::new();
        match self {
            Form::Raw(_) | Form::RawSerde(_) => {
                return Err("what its bytes mean is not known".to_owned());
            }
            Form::Text(most) => {
                put_length(given.len(), &mut bytes);
                bytes.extend(given.as_bytes());
                if bytes.len() > *most {
                    return Err(format!("it takes {} of at most {most} bytes", bytes.len()));
                }
            }
            Form::Scalar(Scalar::Char) => Scalar::Char.parse(given, &mut bytes)?,
            _ => {
                let is_between = |c: char| "[],()".contains(c) || c.is_whitespace();
                let mut words = given.split(is_between).filter(|word| !word.is_empty());
                self.parse_words(&mut words, &mut bytes)?;
                if let Some(more) = words.next() {
                    return Err(format!("`{more}` and what follows is too much"));
                }
            }
        }
        Ok(bytes)
    }

    fn parse_words<'w>(
        &self,
        words: &mut impl Iterator<Item = &'w str>,
        bytes: &mut Vec<u8>,
    ) -> Result<(), String> {
        match self {
            Form::Scalar(scalar) => {
                let word = words.next().ok_or("there are too few elements")?;
                scalar.parse(word, bytes)
            }
            // Of empty elements there may be more than can be counted through.
            Form::Array(element, _) if element.size() == 0 => Ok(()),
            Form::Array(element, length) => {
                (0..*length).try_for_each(|_| element.parse_words(words, bytes))
            }
            _ => Ok(()),
        }
    }

    /// Shows a value.
    pub(super) fn print(&self, bytes: &[u8], f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Form::Scalar(scalar) => match scalar.read(bytes) {
                Some(part) => write!(f, "{part}"),
                None => f.write_char('?'),
            },
            Form::Array(element, _) => {
                f.write_char('[')?;
                for (index, part) in element.each(bytes).enumerate() {
                    if index > 0 {
                        f.write_str(", ")?;
                    }
                    element.print(part, f)?;
                }
                f.write_char(']')
            }
            Form::Unit => f.write_str("()"),
            Form::Text(_) => f.write_str(text(bytes).unwrap_or_default()),
            Form::Raw(_) | Form::RawSerde(_) => {
                bytes.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
            }
        }
    }

    /// The value for a serializer.
    #[cfg(feature = "serde")]
    pub(super) fn serialize<S: serde::Serializer>(
        &self,
        bytes: &[u8],
        to: S,
    ) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeSeq;
        match self {
            Form::Scalar(scalar) => match scalar.read(bytes) {
                Some(Part::Unsigned(value)) => match u64::try_from(value) {
                    Ok(value) => to.serialize_u64(value),
                    Err(_) => to.serialize_u128(value),
                },
                Some(Part::Signed(value)) => match i64::try_from(value) {
                    Ok(value) => to.serialize_i64(value),
                    Err(_) => to.serialize_i128(value),
                },
                Some(Part::Single(value)) => to.serialize_f32(value),
                Some(Part::Double(value)) => to.serialize_f64(value),
                Some(Part::Bool(value)) => to.serialize_bool(value),
                Some(Part::Char(value)) => to.serialize_char(value),
                None => to.serialize_unit(),
            },
            Form::Array(element, length) => {
                let mut list = to.serialize_seq(Some(*length))?;
                for part in element.each(bytes) {
                    list.serialize_element(&Element(element, part))?;
                }
                list.end()
            }
            Form::Unit => to.serialize_unit(),
            Form::Text(_) => to.serialize_str(text(bytes).unwrap_or_default()),
            Form::Raw(_) | Form::RawSerde(_) => {
                let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                to.serialize_str(&digits)
            }
        }
    }
}

/// A part of an array, for a serializer.
#[cfg(feature = "serde")]
struct Element<'a>(&'a Form, &'a [u8]);

#[cfg(feature = "serde")]
impl serde::Serialize for Element<'_> {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(self.1, to)
    }
}

/// Postcard's length of a string: 7 bits a byte, the lowest first.
fn put_length(mut length: usize, bytes: &mut Vec<u8>) {
    while length >= 0x80 {
        bytes.push(length as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
}

/// The string that postcard has encoded.
fn text(bytes: &[u8]) -> Option<&str> {
    let mut length = 0_usize;
    for (index, byte) in bytes.iter().enumerate() {
        let shift = u32::try_from(index).ok()?.checked_mul(7)?;
        length |= usize::from(byte & 0x7f).checked_shl(shift)?;
        if byte & 0x80 == 0 {
            let (_, rest) = bytes.split_at_checked(index)?;
            let rest = rest.get(1..)?.get(..length)?;
            return std::str::from_utf8(rest).ok();
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of<T: crate::ZeroCopySend>() -> Option<Form> {
        Form::plain(&TypeInfo::of::<T>(0))
    }

    #[test]
    fn names_say_how_values_lie() {
        assert_eq!(of::<f32>(), Some(Form::Scalar(Scalar::F32)));
        let row = Form::Array(Box::new(Form::Scalar(Scalar::I16)), 3);
        assert_eq!(of::<[[i16; 3]; 2]>(), Some(Form::Array(Box::new(row), 2)));
        assert_eq!(of::<()>(), Some(Form::Unit));
        // A name that something else has taken.
        for (name, size, align) in [
            ("f32", 8, 8),
            ("u64", 8, 1),
            ("[u8; x]", 4, 1),
            ("cell::Block", 8, 8),
        ] {
            assert_eq!(
                Form::plain(&TypeInfo::new(name, size, align, 0)),
                None,
                "{name}"
            );
        }
        let huge = format!("[u64; {}]", usize::MAX);
        assert_eq!(Form::plain(&TypeInfo::new(&huge, 8, 8, 0)), None);
        // Of no bytes, so it may be as long as its name says.
        let name = format!("[(); {}]", usize::MAX);
        let empty = Form::plain(&TypeInfo::new(&name, 0, 1, 0)).unwrap();
        assert_eq!(empty.parse("[]"), Ok(Vec::new()));
    }

    #[test]
    fn bytes_are_the_values_of_rust() {
        let form = of::<[f64; 2]>().unwrap();
        let bytes = [0.1_f64, f64::NEG_INFINITY].map(f64::to_ne_bytes).concat();
        assert_eq!(form.parse("[0.1, -inf]"), Ok(bytes.clone()));
        assert_eq!(form.value(&bytes), Some(bytes));
        assert_eq!(form.value(&[0; 15]), None);
        let form = of::<bool>().unwrap();
        assert_eq!(form.parse(" true "), Ok(vec![1]));
        assert_eq!(form.value(&[2]), None, "neither true nor false");
        let form = of::<char>().unwrap();
        assert_eq!(form.parse("[").unwrap(), u32::from('[').to_ne_bytes());
        assert_eq!(
            form.value(&0xd800_u32.to_ne_bytes()),
            None,
            "half a character"
        );
        assert!(
            of::<u8>()
                .unwrap()
                .parse("1 2")
                .is_err_and(|why| why.contains("`2`"))
        );
    }

    #[cfg(feature = "serde")]
    #[test]
    fn strings_are_those_of_postcard() {
        for length in [0, 1, 127, 128, 300] {
            let string = "ü".repeat(length);
            let mut room = [0; 700];
            let encoded = postcard::to_slice(&string, &mut room).unwrap();
            let form = Form::Text(700);
            assert_eq!(form.parse(&string).unwrap(), encoded);
            assert_eq!(text(encoded), Some(&*string));
            let place = form.laid_out(encoded);
            assert_eq!(form.taken_up(&place).as_deref(), Some(&*encoded));
        }
        assert_eq!(text(&[5, b'a']), None, "the end is missing");
        assert_eq!(text(&[0xff; 12]), None);
        assert!(Form::Text(4).parse("four").is_err());
        let beyond = [usize::MAX.to_ne_bytes(), [0; 8]].concat();
        assert_eq!(Form::Text(8).taken_up(&beyond), None);
    }
}
