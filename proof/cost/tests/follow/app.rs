//! The task of `program.rs` for the analysis, which reads the application's source.

#[rtic::app(device = chip)]
mod app {
    #[task(binds = PendSV, priority = 1)]
    fn count(_: count::Context) {}
}
