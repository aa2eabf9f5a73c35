//! Makes Rust and the linker's numbers of the board that the firmware is built for.
//!
//! `LEADSCREW_BOARD` names it; `docs/boards.md` explains the files. On the host there is no board.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=memory.x");
    // What a machine with motors driven by phases has beyond the others; also the simulator.
    println!("cargo::rustc-check-cfg=cfg(arc_machine)");
    let is_host = std::env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none");
    if is_host || std::env::var_os("CARGO_FEATURE_PHASES").is_some() {
        println!("cargo::rustc-cfg=arc_machine");
    }
    // A board in the environment, as for what Cargo starts for one, changes nothing on the host.
    if is_host {
        println!("cargo::rustc-env=LEADSCREW_BOARD_TITLE=simulator");
        return;
    }
    println!("cargo::rerun-if-env-changed=LEADSCREW_BOARD");
    // Tests log with `defmt`.
    println!("cargo::rustc-link-arg-tests=-Tdefmt.x");
    println!("cargo::rustc-link-arg-examples=-Tdefmt.x");
    #[cfg(feature = "board")]
    if let Err(error) = board::make() {
        println!("cargo::error={error}");
    }
}

#[cfg(feature = "board")]
mod board {
    use std::{env, error::Error, fs, path::Path};

    use board_data::{
        BOARD, Board, Clocks, DEFAULT, EEPROM, FINGERPRINT, PHASES, SMALL_EEPROM, USB, fingerprint,
        rust,
    };

    /// Writes the board's source, and tells the linker where program and memory are.
    pub(crate) fn make() -> Result<(), Box<dyn Error>> {
        let root = env::var("CARGO_MANIFEST_DIR")?;
        let root = Path::new(&root);
        println!("cargo::rerun-if-changed=boards");
        let name = env::var(BOARD).unwrap_or_else(|_| DEFAULT.into());
        let file = Board::path(&name, root);
        println!("cargo::rerun-if-changed={}", file.display());
        let board = Board::read(&file, root)?;
        let has = |feature: &str| {
            let variable = feature.to_uppercase().replace('-', "_");
            env::var_os(format!("CARGO_FEATURE_{variable}")).is_some()
        };
        let mut axes = [6, 5, 4].into_iter();
        let axes = axes.find(|axes| has(&format!("axes-{axes}")));
        let axes = axes.unwrap_or(3);
        let needed = board.features(axes);
        if let Some(missing) = needed.iter().find(|feature| !has(feature)) {
            return Err(format!("{name} needs the feature {missing}").into());
        }
        // What the board does not need must not be there: its times or its outputs would be others.
        let mut special = Clocks::features().chain([PHASES, EEPROM, SMALL_EEPROM, USB]);
        if let Some(other) = special.find(|&it| has(it) && !needed.iter().any(|own| own == it)) {
            return Err(format!("{name} is no board for the feature {other}").into());
        }
        if board.wiring(axes).is_none() {
            let most = board.most_axes();
            return Err(format!("{name} has pins for {most} axes, not for {axes}").into());
        }
        let source = Path::new(&env::var("OUT_DIR")?).join("board.rs");
        fs::write(source, rust(&board, axes))?;
        let clocks = [
            ("CRYSTAL_HZ", (board.crystal_mhz * 1_000_000).to_string()),
            ("BOARD_TITLE", board.title.clone()),
            ("CRYSTAL_BYPASSED", board.is_crystal_bypassed.to_string()),
            (
                "CORE_HZ",
                (board.chip.clocks.core_mhz * 1_000_000).to_string(),
            ),
        ];
        for (name, value) in clocks {
            println!("cargo::rustc-env=LEADSCREW_{name}={value}");
        }
        let memory = board.memory(axes);
        let symbols = [
            ("_flash_start", memory.flash_start),
            ("_flash_length", memory.flash_bytes),
            ("_ram_length", memory.ram_bytes),
            (FINGERPRINT, fingerprint(&board, axes)),
        ];
        for (symbol, value) in symbols {
            println!("cargo::rustc-link-arg=--defsym={symbol}={value:#x}");
        }
        let scripts = env::var("OUT_DIR")?;
        let script = Path::new(&scripts).join("code_start.x");
        fs::write(script, code_start(memory.code_start))?;
        println!("cargo::rustc-link-search={scripts}");
        Ok(())
    }

    /// Returns the part of the linker's script that says where code begins: at an address, or right behind the
    /// vectors.
    fn code_start(address: Option<u32>) -> String {
        let place = address.map_or_else(String::new, |start| format!("_stext = {start:#x};\n"));
        format!(
            "_vectors_end = ADDR(.vector_table) + SIZEOF(.vector_table);\n{place}ASSERT(ADDR(.text) == _stext, \"the code does not begin where the board's file wants it\");\n"
        )
    }
}
