//! What tests share. Crates below this one ([`sspc_core`] and what it knows) are tested by the package `tests`; the
//! two programs have it as a development dependency.
//!
//! | module | what it gives |
//! |---|---|
//! | [`frames`] | frames in memory: the textured scene, the sample, prepared halves |
//! | [`small_frame`] | a frame as files for command lines |
//! | [`lit_frame`] | a frame as files whose colour is the sum of passes |
//! | [`made_shot`] | a shot as files, with motion |
//! | [`exr_parts`] | small OpenEXR files, part by part |
//! | [`models`] | made-up models and features |
//! | [`case`](mod@case) | the parity cases of the PyTorch reference |
//! | [`closeness`] | comparisons that say how many values differ, the first and the worst |
//! | [`kernels`] | a network's and g_c's pass over a whole picture, a step's loss |
//! | [`method`] | the way from a frame to its picture |
//! | [`golden`] | hashes of pixels made before |
//! | [`faults`] | kills, interrupts, full disks |
//! | [`peak`] | the most memory held at once |
//! | [`c_programs`] | C, compiled for a test |
//! | [`skips`] | what a test cannot do here, said aloud |
#![forbid(unsafe_code)]
#![expect(missing_docs, reason = "fields of test data: their names say it")]

pub mod c_programs;
pub mod case;
pub mod closeness;
pub mod exr_parts;
pub mod faults;
pub mod frames;
pub mod golden;
pub mod kernels;
pub mod lit_frame;
pub mod made_shot;
pub mod method;
pub mod models;
pub mod peak;
pub mod skips;
pub mod small_frame;
