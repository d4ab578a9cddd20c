"""The work behind the calls: worker threads, batches, admission, streams, compositions. It knows no HTTP."""
