"""Work behind the routes: worker threads, batches, admission, streams, compositions. It knows no HTTP."""
