//! Ports: where stages join. `in_ports!` and `out_ports!` turn a struct of payloads into ports.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde_json::Value;

use crate::artifact::{Artifact, ArtifactKind, ImageStack, LayerInfo};
use crate::error::Error;
use crate::head::{Head, kept};
use crate::payload::{Payload, Quantity};
use crate::shared::Shared;

/// The axes of an instance with their values: `{A_rho: 1.0, S_rho: 5000.0}`.
pub type Axes = BTreeMap<String, Value>;

/// How many artifacts an input port takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arity {
    One,
    Optional,
    /// Zero or more; loaded one by one, on access.
    Many,
    /// One or more.
    Some,
}

/// An input port.
#[derive(Clone, Debug)]
pub struct InPort {
    pub name: &'static str,
    pub payload: &'static str,
    /// The payloads that may be connected: `payload`, or those that it is one of.
    pub accepts: &'static [&'static str],
    pub arity: Arity,
    pub about: &'static str,
}

/// An output port.
#[derive(Clone, Debug)]
pub struct OutPort {
    pub name: &'static str,
    pub payload: &'static str,
    pub kind: ArtifactKind,
    /// Computed only if someone wants it.
    pub optional: bool,
    /// Optional, made for people: wanted whenever the stage has few instances.
    pub preview: bool,
    pub about: &'static str,
    /// What the artifact may hold: layers or columns with their units.
    pub holds: &'static [Quantity],
}

/// Where a running stage gets its inputs from.
pub trait InputSource {
    /// The artifact on a `one` or `optional` port.
    fn one(&self, port: &str) -> Result<Option<Artifact>, Error>;
    /// The axes of everything on a `many` port, in the order of their values.
    fn many(&self, port: &str) -> Vec<Axes>;
    /// The artifact on a `one` port where other instances of the run read it too: what is made of it is kept for all of them.
    fn shared(&self, _port: &str) -> Result<Option<Shared>, Error> {
        Ok(None)
    }
    /// What the image stack on a `one` port is. Error: there is none.
    fn head(&self, port: &str) -> Result<Head, Error> {
        Ok(Head::of(&images(self.one(port)?, port)?))
    }
    /// Those of its layers that are wanted, by their place and what they are; as often as asked.
    fn part(&self, port: &str, wanted: &dyn Fn(usize, &LayerInfo) -> bool) -> Result<ImageStack, Error> {
        Ok(kept(Cow::Owned(images(self.one(port)?, port)?), wanted))
    }
    /// One artifact of a `many` port.
    fn load(&self, port: &str, index: usize) -> Result<Artifact, Error>;
}

fn images(artifact: Option<Artifact>, port: &str) -> Result<ImageStack, Error> {
    match artifact {
        Some(Artifact::Images(stack)) => Ok(stack),
        Some(other) => Err(Error::failed(format!("input `{port}` must be an image stack, not {:?}", other.kind()))),
        None => Err(Error::failed(format!("input `{port}` is not connected"))),
    }
}

/// The artifacts of a `many` port: axes now, each artifact when asked for.
pub struct Many<'a, T> {
    port: &'static str,
    axes: Vec<Axes>,
    source: &'a dyn InputSource,
    payload: std::marker::PhantomData<T>,
}

impl<'a, T: Payload> Many<'a, T> {
    pub fn new(port: &'static str, source: &'a dyn InputSource) -> Self {
        Self { port, axes: source.many(port), source, payload: std::marker::PhantomData }
    }

    pub fn axes(&self) -> &[Axes] {
        &self.axes
    }

    /// Loads the `index`-th artifact (order of `axes`).
    pub fn load(&self, index: usize) -> Result<T, Error> {
        T::from_artifact(self.source.load(self.port, index)?)
    }
}

/// The inputs of a stage, implemented by `in_ports!`.
pub trait InPorts {
    type Loaded<'a>;
    fn ports() -> Vec<InPort>;
    fn load<'a>(source: &'a dyn InputSource) -> Result<Self::Loaded<'a>, Error>;
}

/// The outputs of a stage, implemented by `out_ports!`.
pub trait OutPorts {
    fn ports() -> Vec<OutPort>;
    fn into_artifacts(self) -> Vec<(&'static str, Artifact)>;
    /// The same with the payloads that the artifacts were made of.
    fn into_shared(self) -> Vec<(&'static str, Shared)>;
}

/// Loads the artifact on a port that must be connected.
pub fn load_one<T: Payload>(source: &dyn InputSource, port: &'static str) -> Result<T, Error> {
    if let Some(typed) = source.shared(port)?.and_then(|shared| shared.get::<T>()) {
        return Ok((*typed).clone());
    }
    let artifact = source.one(port)?.ok_or_else(|| Error::failed(format!("input `{port}` is not connected")))?;
    T::from_artifact(artifact)
}

/// Loads the artifact on a port that may be left open.
pub fn load_optional<T: Payload>(source: &dyn InputSource, port: &'static str) -> Result<Option<T>, Error> {
    source.one(port)?.map(T::from_artifact).transpose()
}

/// Declares the inputs of a stage.
///
/// ```text
/// in_ports! {
///     pub struct In {
///         /// Camera frames.
///         frames: one Frames,
///         /// Their covariance.
///         covariance: optional Covariance,
///         /// Phantoms to build the table from.
///         phantoms: many Modulation,
///     }
/// }
/// ```
/// `frames: parts Frames` is the same port as `one`, of an image stack whose layers the stage asks for ([`Parts`](crate::Parts)). This
/// makes `struct In<'a> { frames: Frames, covariance: Option<Covariance>, phantoms: Many<'a, Modulation> }`; the
/// `Stage::In` type is `In<'static>`.
#[macro_export]
macro_rules! in_ports {
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($(#[doc = $doc:literal])* $port:ident : $arity:ident $payload:ty),* $(,)? }) => {
        $(#[$meta])*
        $vis struct $name<'a> {
            $($(#[doc = $doc])* pub $port: $crate::in_ports!(@slot 'a $arity $payload),)*
            #[doc(hidden)]
            pub source: std::marker::PhantomData<&'a ()>,
        }
        impl $crate::InPorts for $name<'static> {
            type Loaded<'a> = $name<'a>;
            fn ports() -> Vec<$crate::InPort> {
                vec![$($crate::InPort {
                    name: stringify!($port),
                    payload: <$payload as $crate::Payload>::NAME,
                    accepts: <$payload as $crate::Payload>::ACCEPTS,
                    arity: $crate::in_ports!(@arity $arity),
                    about: concat!($($doc),*).trim_ascii(),
                }),*]
            }
            #[allow(unused_variables, reason = "a stage without inputs reads no source")]
            fn load<'a>(source: &'a dyn $crate::InputSource) -> Result<$name<'a>, $crate::Error> {
                Ok($name {
                    $($port: $crate::in_ports!(@load $arity $payload, source, stringify!($port)),)*
                    source: std::marker::PhantomData,
                })
            }
        }
    };
    (@slot $life:lifetime one $payload:ty) => { $payload };
    (@slot $life:lifetime parts $payload:ty) => { $crate::Parts<$life, $payload> };
    (@slot $life:lifetime optional $payload:ty) => { Option<$payload> };
    (@slot $life:lifetime many $payload:ty) => { $crate::Many<$life, $payload> };
    (@slot $life:lifetime some $payload:ty) => { $crate::Many<$life, $payload> };
    (@arity one) => { $crate::Arity::One };
    (@arity parts) => { $crate::Arity::One };
    (@arity optional) => { $crate::Arity::Optional };
    (@arity many) => { $crate::Arity::Many };
    (@arity some) => { $crate::Arity::Some };
    (@load one $payload:ty, $source:ident, $port:expr) => { $crate::port::load_one::<$payload>($source, $port)? };
    (@load parts $payload:ty, $source:ident, $port:expr) => { $crate::Parts::<$payload>::open($port, $source)? };
    (@load optional $payload:ty, $source:ident, $port:expr) => { $crate::port::load_optional::<$payload>($source, $port)? };
    (@load many $payload:ty, $source:ident, $port:expr) => { $crate::Many::<$payload>::new($port, $source) };
    (@load some $payload:ty, $source:ident, $port:expr) => { $crate::Many::<$payload>::new($port, $source) };
}

/// Declares the outputs of a stage: `port: one Payload`, `port: optional Payload`, `port: preview Payload`.
///
/// `optional` and `preview` fields become `Option<Payload>`; fill them when `ctx.wants("port")`.
#[macro_export]
macro_rules! out_ports {
    ($(#[$meta:meta])* $vis:vis struct $name:ident { $($(#[doc = $doc:literal])* $port:ident : $arity:ident $payload:ty),* $(,)? }) => {
        $(#[$meta])*
        $vis struct $name { $($(#[doc = $doc])* pub $port: $crate::out_ports!(@slot $arity $payload),)* }
        impl $crate::OutPorts for $name {
            fn ports() -> Vec<$crate::OutPort> {
                vec![$($crate::OutPort {
                    name: stringify!($port),
                    payload: <$payload as $crate::Payload>::NAME,
                    kind: <$payload as $crate::Payload>::KIND,
                    optional: $crate::out_ports!(@optional $arity),
                    preview: $crate::out_ports!(@preview $arity),
                    about: concat!($($doc),*).trim_ascii(),
                    holds: <$payload as $crate::Payload>::HOLDS,
                }),*]
            }
            fn into_artifacts(self) -> Vec<(&'static str, $crate::Artifact)> {
                let mut out = Vec::new();
                $($crate::out_ports!(@store $arity out, self.$port, stringify!($port), $crate::Payload::into_artifact);)*
                out
            }
            fn into_shared(self) -> Vec<(&'static str, $crate::Shared)> {
                let mut out = Vec::new();
                $($crate::out_ports!(@store $arity out, self.$port, stringify!($port), $crate::Shared::of);)*
                out
            }
        }
    };
    (@slot one $payload:ty) => { $payload };
    (@slot optional $payload:ty) => { Option<$payload> };
    (@slot preview $payload:ty) => { Option<$payload> };
    (@optional one) => { false };
    (@optional optional) => { true };
    (@optional preview) => { true };
    (@preview one) => { false };
    (@preview optional) => { false };
    (@preview preview) => { true };
    (@store one $out:ident, $value:expr, $port:expr, $made:expr) => { $out.push(($port, $made($value))) };
    (@store $optional:ident $out:ident, $value:expr, $port:expr, $made:expr) => {
        if let Some(payload) = $value { $out.push(($port, $made(payload))) }
    };
}
