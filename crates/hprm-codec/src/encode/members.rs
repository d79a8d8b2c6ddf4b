//! What a container holds: the members of a list or tuple, the entries of a dict.

use serde::Serialize;
use serde::ser::{
    SerializeMap, SerializeSeq, SerializeStruct, SerializeStructVariant, SerializeTuple,
    SerializeTupleStruct, SerializeTupleVariant,
};

use super::Writer;
use crate::cursor::Cursor;
use crate::error::EncodeError;
use crate::format::{NodeKind, insert_number, put_number};
use crate::place;

/// A container that is being encoded.
pub(super) struct Members<'w> {
    writer: &'w mut Writer,
    /// How many members it has, if it has said so.
    announced: Option<usize>,
    /// Where their number belongs.
    count_at: usize,
    /// How many have been written.
    count: usize,
    /// Where the last key begins.
    key_at: usize,
    /// The variant whose contents these are.
    variant: Option<&'static str>,
}

impl<'w> Members<'w> {
    pub(super) fn begin(
        writer: &'w mut Writer,
        kind: NodeKind,
        announced: Option<usize>,
    ) -> Result<Self, EncodeError> {
        writer.open(kind)?;
        let count_at = writer.head.written().len();
        if let Some(count) = announced {
            put_number(&mut writer.head, count as u64);
        }
        Ok(Self { writer, announced, count_at, count: 0, key_at: count_at, variant: None })
    }

    /// They are the contents of that variant.
    pub(super) fn of_variant(mut self, variant: &'static str) -> Self {
        self.variant = Some(variant);
        self
    }

    fn element<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), EncodeError> {
        let at = self.count;
        self.count += 1;
        let written = value.serialize(&mut *self.writer);
        written.map_err(|error| self.in_variant(error.within(|| place::index(at))))
    }

    // Inline, because the length of the key is known where a field is written.
    #[inline(always)]
    fn field<T: Serialize + ?Sized>(
        &mut self,
        key: &'static str,
        value: &T,
    ) -> Result<(), EncodeError> {
        self.count += 1;
        self.writer.text(key)?;
        let written = value.serialize(&mut *self.writer);
        written.map_err(|error| self.in_variant(error.within(|| format!("['{key}']"))))
    }

    fn in_variant(&self, error: EncodeError) -> EncodeError {
        match self.variant {
            Some(variant) => error.within(|| format!("['{variant}']")),
            None => error,
        }
    }

    fn finish(self) -> Result<(), EncodeError> {
        match self.announced {
            None => insert_number(&mut self.writer.head, self.count_at, self.count as u64),
            Some(announced) if announced != self.count => {
                return Err(EncodeError::new(format!(
                    "its `Serialize` announces {announced} members and writes {}",
                    self.count
                )));
            }
            Some(_) => {}
        }
        self.writer.depth -= if self.variant.is_some() { 2 } else { 1 };
        Ok(())
    }
}

/// Containers whose members have no keys.
macro_rules! elements {
    ($($of:ident: $method:ident;)*) => {$(
        impl $of for Members<'_> {
            type Ok = ();
            type Error = EncodeError;

            fn $method<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), EncodeError> {
                self.element(value)
            }

            fn end(self) -> Result<(), EncodeError> {
                self.finish()
            }
        }
    )*};
}

elements! {
    SerializeSeq: serialize_element;
    SerializeTuple: serialize_element;
    SerializeTupleStruct: serialize_field;
    SerializeTupleVariant: serialize_field;
}

/// Containers whose members are fields.
macro_rules! fields {
    ($($of:ident)*) => {$(
        impl $of for Members<'_> {
            type Ok = ();
            type Error = EncodeError;

            #[inline(always)]
            fn serialize_field<T: Serialize + ?Sized>(
                &mut self,
                key: &'static str,
                value: &T,
            ) -> Result<(), EncodeError> {
                self.field(key, value)
            }

            fn end(self) -> Result<(), EncodeError> {
                self.finish()
            }
        }
    )*};
}

fields! { SerializeStruct SerializeStructVariant }

impl SerializeMap for Members<'_> {
    type Ok = ();
    type Error = EncodeError;

    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Result<(), EncodeError> {
        self.count += 1;
        self.key_at = self.writer.head.written().len();
        key.serialize(&mut *self.writer).map_err(|error| error.within(|| "{key ...}".to_owned()))
    }

    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Result<(), EncodeError> {
        value.serialize(&mut *self.writer).map_err(|error| {
            let key = self.writer.head.written().get(self.key_at..).unwrap_or_default();
            error.within(|| place::item(Cursor::new(key)))
        })
    }

    fn end(self) -> Result<(), EncodeError> {
        self.finish()
    }
}
