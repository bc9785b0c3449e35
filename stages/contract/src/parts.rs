//! Image stacks of which a stage takes one part after the other, so that it never holds the whole.

use std::borrow::Cow;
use std::marker::PhantomData;

use crate::artifact::{Artifact, ImageStack, LayerInfo, LayerKind};
use crate::error::Error;
use crate::head::{Head, kept};
use crate::payload::Payload;
use crate::port::InputSource;

/// The image stack of a `parts` port: what it is now, its layers when they are asked for.
pub struct Parts<'a, T> {
    head: Head,
    from: Origin<'a>,
    payload: PhantomData<T>,
}

enum Origin<'a> {
    Source(&'static str, &'a dyn InputSource),
    Memory(ImageStack),
}

impl<'a, T: Payload> Parts<'a, T> {
    /// Error: nothing, or what is no image stack, is on the port.
    pub fn open(port: &'static str, source: &'a dyn InputSource) -> Result<Self, Error> {
        Ok(Self { head: source.head(port)?, from: Origin::Source(port, source), payload: PhantomData })
    }

    pub fn head(&self) -> &Head {
        &self.head
    }

    /// All layers.
    pub fn whole(&self) -> Result<T, Error> {
        self.part(&|_, _| true)
    }

    /// The layers that `wanted` says yes to, by their place and what they are, in their order; where one points to others (`pair`), it
    /// is by the places in the whole.
    pub fn part(&self, wanted: &dyn Fn(usize, &LayerInfo) -> bool) -> Result<T, Error> {
        let part = match &self.from {
            Origin::Source(port, source) => source.part(port, wanted)?,
            Origin::Memory(stack) => kept(Cow::Borrowed(stack), wanted),
        };
        T::from_artifact(Artifact::Images(part))
    }

    /// What belongs to one wavelength: its layers, and masks that hold for all.
    pub fn channel(&self, wavelength_nm: Option<f64>) -> Result<T, Error> {
        self.part(&|_, info| is_of_channel(info, wavelength_nm))
    }

    /// Where the layers of [`channel`](Self::channel) are in the whole.
    pub fn places(&self, wavelength_nm: Option<f64>) -> Vec<usize> {
        let layers = self.head.layers.iter().enumerate();
        layers.filter(|(_, info)| is_of_channel(info, wavelength_nm)).map(|(place, _)| place).collect()
    }

    /// The layers that say how the surface lies to the light.
    pub fn conditions(&self) -> Result<T, Error> {
        self.part(&|_, info| info.kind == LayerKind::Condition)
    }

    /// The most layers that [`channel`](Self::channel) gives for one of these wavelengths.
    pub fn most_of_a_channel(layers: &[LayerInfo], wavelengths: &[Option<f64>]) -> usize {
        let of = |w: &Option<f64>| layers.iter().filter(|info| is_of_channel(info, *w)).count();
        wavelengths.iter().map(of).max().unwrap_or(layers.len())
    }
}

fn is_of_channel(info: &LayerInfo, wavelength_nm: Option<f64>) -> bool {
    let shared = info.wavelength_nm.is_none() && info.kind == LayerKind::Mask;
    info.kind != LayerKind::Condition && (info.wavelength_nm == wavelength_nm || shared)
}

/// A payload that is in memory.
impl<T: Payload> From<T> for Parts<'_, T> {
    fn from(payload: T) -> Self {
        let Artifact::Images(stack) = payload.into_artifact() else { panic!("{} is no image stack", T::NAME) };
        Self { head: Head::of(&stack), from: Origin::Memory(stack), payload: PhantomData }
    }
}
