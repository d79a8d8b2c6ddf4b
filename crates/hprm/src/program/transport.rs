//! Values on their way to other federates: typed at both ends, and between them the safe codec of `hprm-codec`.
//!
//! Which type a channel has is known where it was connected. Large arrays lie in the object store, where receivers read
//! them; this file decides what of a value is there already, and what is copied.

use std::any::TypeId;
use std::collections::BTreeMap;
use std::sync::{Arc, Weak};

use hprm_codec::{DecodeError, Draft, EncodeError, Memory, Source, Transfer};
use hprm_core::{ChannelId, Connection, Part, Payload, PortId, Program, Table};
use hprm_store::{Object, StoreAllocator};

use super::sender::Sent;
use super::value::{Value, stored_type};
use crate::failure::Source as Code;
use crate::{Failure, copy_value};

/// The most arrays of which the copies in the store are remembered.
const REMEMBERED: usize = 8;

type Encode = fn(&Value) -> Option<Result<Draft, EncodeError>>;
type Decode = fn(&[u8], &[Arc<dyn Memory>]) -> Result<Value, DecodeError>;

/// How values of one type travel.
#[derive(Clone, Copy)]
pub(super) struct Codec {
    name: fn() -> &'static str,
    stored: fn() -> [TypeId; 2],
    encode: Encode,
    decode: Decode,
}

impl Codec {
    pub(super) fn of<T: Transfer>() -> Self {
        Self {
            name: std::any::type_name::<T>,
            stored: || [stored_type::<T>(), stored_type::<Sent<T>>()],
            encode: |value| {
                let value = value.get::<T>().or_else(|| value.get::<Sent<T>>().map(Sent::value));
                value.map(hprm_codec::send)
            },
            decode: |head, parts| hprm_codec::receive::<T>(head, parts).map(Value::new),
        }
    }

    /// What tells that a value has the type, at a port or of a physical action.
    pub(super) fn stored(self) -> [TypeId; 2] {
        (self.stored)()
    }

    /// Encodes a value, if it has the type.
    pub(super) fn encode(self, value: &Value) -> Option<Result<Draft, EncodeError>> {
        (self.encode)(value)
    }

    /// The name of the type.
    pub(super) fn type_name(self) -> &'static str {
        (self.name)()
    }
}

/// Memory of an object store, which an array reads in place.
pub(super) struct InStore(pub(super) Object);

impl Memory for InStore {
    fn bytes(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

/// What carries the values of a federate.
pub(super) struct Transport {
    program: Arc<Program>,
    codecs: Table<ChannelId, Option<Codec>>,
    /// What the last payload refers to, until the loop has added its readers.
    holds: Vec<Object>,
    /// Arrays of the heap that were copied into the store, so that a second receiver of one gets the same copy.
    copied: Vec<(Weak<dyn Memory>, Object)>,
    /// The first channel whose value could not be read, and why.
    warnings: Vec<String>,
}

impl Transport {
    /// The transport of a federate; `codecs` are those of the ports that are connected to other federates.
    pub(super) fn new(program: &Arc<Program>, codecs: &BTreeMap<PortId, Codec>) -> Self {
        let of = |connection: &Connection| {
            codecs.get(&connection.from).or_else(|| codecs.get(&connection.to)).copied()
        };
        let channels = program.channels.values();
        Self {
            codecs: channels.map(|channel| of(&program.connections[channel.connection])).collect(),
            program: Arc::clone(program),
            holds: Vec::new(),
            copied: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Forgets what was copied: all of a tag has been sent.
    pub(super) fn forget(&mut self) {
        self.copied.clear();
    }

    /// What is to be told to the user.
    pub(super) fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// Turns a value into a payload.
    pub(super) fn encode(
        &mut self,
        store: &StoreAllocator,
        channel: ChannelId,
        value: &Value,
    ) -> Result<Payload, Failure> {
        self.holds.clear();
        let draft = match self.codecs[channel].and_then(|codec| codec.encode(value)) {
            Some(Ok(draft)) => draft,
            Some(Err(error)) => return Err(self.unsent(channel, &error)),
            None => return Err(self.unsent(channel, &"the port has no type that can be sent")),
        };
        let mut payload = Payload { head: draft.head, ..Payload::default() };
        for source in draft.parts {
            payload.parts.push(self.place(store, source)?);
        }
        Ok(payload)
    }

    /// Makes a value of what has arrived.
    pub(super) fn decode(
        &self,
        channel: ChannelId,
        payload: Payload,
        objects: Vec<Object>,
    ) -> Result<Value, Failure> {
        let mut objects = objects.into_iter();
        // Small values have none.
        let has_parts = !payload.parts.is_empty();
        let parts = payload.parts.into_iter().filter_map(|part| -> Option<Arc<dyn Memory>> {
            Some(match part {
                Part::Inline(bytes) => Arc::new(bytes),
                Part::Object(_) => Arc::new(InStore(objects.next()?)),
                // The link has put an object in its place.
                Part::Shipped(_) => return None,
            })
        });
        let parts: Vec<_> = if has_parts { parts.collect() } else { Vec::new() };
        let Some(codec) = self.codecs[channel] else {
            return Err(self.unread(channel, "?", &"the port has no type that can be received"));
        };
        (codec.decode)(&payload.head, &parts)
            .map_err(|error| self.unread(channel, codec.type_name(), &error))
    }

    fn place(&mut self, store: &StoreAllocator, source: Source) -> Result<Part, Failure> {
        let memory = match source {
            Source::Bytes(bytes) => return self.copy(store, &bytes).map(|(part, _)| part),
            Source::Memory(memory) => memory,
        };
        let stored = memory.downcast_ref::<InStore>();
        if let Some(object) = stored.and_then(|InStore(object)| store.store().forward(object)) {
            return Ok(self.hold(object));
        }
        let known = self.copied.iter().find(|(copied, _)| is_same(copied, &memory));
        if let Some((_, object)) = known {
            let object = object.clone();
            return Ok(self.hold(object));
        }
        let (part, object) = self.copy(store, memory.bytes())?;
        if let Some(object) = object {
            if self.copied.len() >= REMEMBERED {
                self.copied.remove(0);
            }
            self.copied.push((Arc::downgrade(&memory), object));
        }
        Ok(part)
    }

    /// Copies bytes into the store, or into the message if the store has no room for them.
    fn copy(
        &mut self,
        store: &StoreAllocator,
        bytes: &[u8],
    ) -> Result<(Part, Option<Object>), Failure> {
        let mut store = store.store();
        match store.loan(bytes.len()) {
            Ok(mut loan) => {
                copy_value(&mut loan, bytes);
                store.count_copy(bytes.len());
                let object = store.publish(loan);
                Ok((self.hold(object.clone()), Some(object)))
            }
            Err(error) => {
                if let Some(first) =
                    store.fall_back(error).map_err(|error| Failure::store(&error))?
                {
                    self.warnings.push(format!("{first}; the value travels inside its message"));
                }
                let copy = hprm_core::copy_of(bytes);
                let copy = copy.map_err(|error| Failure::Memory(error.to_string()))?;
                Ok((Part::Inline(copy), None))
            }
        }
    }

    fn hold(&mut self, object: Object) -> Part {
        let part = Part::Object(object.object_ref());
        self.holds.push(object);
        part
    }

    /// The names of both ends of a channel.
    fn ends(&self, channel: ChannelId) -> [String; 2] {
        let connection = &self.program.connections[self.program.channels[channel].connection];
        [connection.from, connection.to].map(|port| self.program.port_name(port))
    }

    fn unsent(&self, channel: ChannelId, error: &dyn std::fmt::Display) -> Failure {
        let [from, to] = self.ends(channel);
        let source = Code::Connection { from, to };
        let message = format!("{source}: {error}");
        Failure::raised(source, message)
    }

    fn unread(&self, channel: ChannelId, expected: &str, error: &dyn std::fmt::Display) -> Failure {
        let [from, to] = self.ends(channel);
        let message =
            format!("{to} expects {expected}, and {from} has sent something else: {error}");
        let source = Code::Other(format!("receiving a value on connection {from} -> {to}"));
        Failure::raised(source, message)
            .with_hint("both ends of a connection have one type of values: the handbook page reference/codec says which values fit")
    }
}

fn is_same(copied: &Weak<dyn Memory>, memory: &Arc<dyn Memory>) -> bool {
    copied.upgrade().is_some_and(|copied| Arc::ptr_eq(&copied, memory))
}
