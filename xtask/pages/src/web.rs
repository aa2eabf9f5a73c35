//! The page that runs jobs in the browser, the same code under node, and the page of a release.

pub mod install;
pub mod measure;
pub mod page;
