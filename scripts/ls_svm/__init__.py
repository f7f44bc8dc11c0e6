"""Parts of the study of LS-SVM models of the torpedo AUV; `scripts.reproduce_ls_svm` runs it."""
