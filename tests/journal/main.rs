//! The journal on a flash with the chip's rules, and with power cuts at every word and erase.

mod cuts;
mod damage;
mod history;
mod wear;
