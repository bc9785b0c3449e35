//! Image stacks without their pixels, and with a part of their layers.

use std::borrow::Cow;

use crate::artifact::{Attributes, ImageStack, LayerInfo};

/// What image stack is on a port, without its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Head {
    pub rows: usize,
    pub columns: usize,
    pub attributes: Attributes,
    /// Of its layers, in their order.
    pub layers: Vec<LayerInfo>,
}

impl Head {
    pub fn of(stack: &ImageStack) -> Self {
        let (rows, columns) = (stack.rows(), stack.columns());
        Self { rows, columns, attributes: stack.attributes.clone(), layers: stack.infos() }
    }
}

/// The layers of a stack that are wanted.
pub fn kept(stack: Cow<'_, ImageStack>, wanted: &dyn Fn(usize, &LayerInfo) -> bool) -> ImageStack {
    let mut part = ImageStack::new(stack.rows(), stack.columns());
    part.attributes = stack.attributes.clone();
    match stack {
        Cow::Owned(stack) => {
            let layers = stack.layers.into_iter().enumerate().filter(|(k, layer)| wanted(*k, &layer.info));
            part.layers = layers.map(|(_, layer)| layer).collect();
        }
        Cow::Borrowed(stack) => {
            let layers = stack.layers.iter().enumerate().filter(|(k, layer)| wanted(*k, &layer.info));
            part.layers = layers.map(|(_, layer)| layer.clone()).collect();
        }
    }
    part
}
