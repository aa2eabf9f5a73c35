//! The page that runs jobs in the browser, and the same code under node.

pub mod measure;
pub mod page;
