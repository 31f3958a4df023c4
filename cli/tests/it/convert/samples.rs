//! A sample in an MCAP file, by the schema that stands there, decoded by `prost`.

use prost::Message;
use prost_types::FileDescriptorSet;
use prost_types::field_descriptor_proto::{Label, Type};

/// The bytes of a sample, and what its schema says of its field `value`.
pub(super) struct Sample<'a> {
    data: &'a [u8],
    of: (Type, Label),
}

/// The sample in a message, whose schema has to have one message of one field.
pub(super) fn sample<'a>(message: &'a mcap::Message<'_>) -> Sample<'a> {
    assert_eq!(message.channel.message_encoding, "protobuf");
    let schema = message.channel.schema.as_ref().unwrap();
    assert_eq!(schema.encoding, "protobuf");
    let files = FileDescriptorSet::decode(&*schema.data).unwrap().file;
    let [file] = &*files else {
        panic!("{files:?}");
    };
    assert_eq!((file.package(), file.syntax()), ("luna", "proto3"));
    let [described] = &*file.message_type else {
        panic!("{file:?}");
    };
    assert_eq!(schema.name, format!("luna.{}", described.name()));
    let [field] = &*described.field else {
        panic!("{described:?}");
    };
    assert_eq!((field.name(), field.number()), ("value", 1));
    Sample {
        data: &message.data,
        of: (field.r#type(), field.label()),
    }
}

macro_rules! decoders {
    ($($name:ident: $value:ty, $kind:ident, $label:ident, ($($attribute:tt)*);)*) => {
        impl Sample<'_> {$(
            pub(super) fn $name(&self) -> $value {
                #[derive(Message)]
                struct Form {
                    #[prost($($attribute)*, tag = "1")]
                    value: $value,
                }
                assert_eq!(self.of, (Type::$kind, Label::$label));
                Form::decode(self.data).unwrap().value
            }
        )*}
    };
}

decoders! {
    double: f64, Double, Optional, (double);
    floats: Vec<f32>, Float, Repeated, (float, repeated);
    signed: i64, Sint64, Optional, (sint64);
    small: Vec<i32>, Sint32, Repeated, (sint32, repeated);
    truth: bool, Bool, Optional, (bool);
}
