//! What flattening needs to know about the skin: a disk with holes, laid out face by face.

pub(super) mod disk;
pub(super) mod elements;
pub(super) mod magnification;
pub(super) mod prescribed;
pub(super) mod flatten_domain;
