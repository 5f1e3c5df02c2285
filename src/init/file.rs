//! A file of a set.

/// A file to be written.
pub(super) struct File {
    /// Name within the folder.
    pub(super) name: &'static str,
    /// Its text.
    pub(super) text: String,
}
