//! The tests of `gaitfit-view`: one program, one module for each subject.

mod fit_page;
#[path = "common/go2.rs"]
mod go2;
#[path = "common/invented.rs"]
mod invented;
#[path = "common/invented_loop.rs"]
mod invented_loop;
mod learning_pages;
mod look_pages;
mod loop_page;
#[path = "common/page.rs"]
mod page;
mod pictures;
mod replay_page;
mod replay_script;
